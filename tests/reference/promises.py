"""What the READMEs promise, and the tests that hold it; `promises.toml` lists both."""

import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]


def promises() -> dict[str, dict[str, list[str]]]:
    """Tests of each promise, by the README that makes it."""
    text = Path(__file__).with_suffix(".toml").read_text(encoding="utf-8")
    return tomllib.loads(text)


def unkept() -> list[str]:
    """Return the promises that their README does not make, and the tests that do not exist."""
    faults = []
    for page, rows in promises().items():
        text = " ".join((ROOT / page).read_text(encoding="utf-8").split())
        faults += [f"{page}: {promise}" for promise in rows if promise not in text]
        tests = {test for row in rows.values() for test in row}
        faults += [test for test in sorted(tests) if not (ROOT / "tests" / test).exists()]
    return faults
