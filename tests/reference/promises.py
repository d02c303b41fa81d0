"""The list of promises in `tests/README.md`: what a README says, and which tests hold it."""

import re
import textwrap
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "tests" / "README.md"
# A promise is cut after so many characters: the table says which one, the TOML file what it is.
_LONGEST = 40
_LIST = re.compile(r"(?<=<!-- promises -->\n).*?(?=<!-- end of promises -->)", re.DOTALL)


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


def page_with_table() -> str:
    """`tests/README.md` with the list of the present promises."""
    lines = []
    for page, rows in promises().items():
        lines += ["", f"**{page}**", ""]
        for promise, tests in rows.items():
            files = " ".join(_short(test, Path(page).parent) for test in tests)
            begin = textwrap.shorten(promise, _LONGEST, placeholder=" ...")
            lines.append(f"- {begin} ({files})")
    table = "\n".join([*lines, "", ""])
    return _LIST.sub(lambda _: table, PAGE.read_text(encoding="utf-8"))


def _short(test: str, folder: Path) -> str:
    """Name of a test, below the folder of its page if it is there."""
    test = test.removeprefix(f"{folder.as_posix()}/")
    return test.removesuffix(".py").replace("test_", "")
