"""The promises of the READMEs, and the list in `tests/README.md` of the files that hold them."""

import re
import tomllib
from pathlib import Path, PurePosixPath

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "tests" / "README.md"
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
    """`tests/README.md` with the list of the files that hold a promise, by their folders."""
    files: dict[str, set[str]] = {}
    for test in {test for rows in promises().values() for row in rows.values() for test in row}:
        path = PurePosixPath(test)
        folder = path.parent if path.suffix else path
        files.setdefault(folder.as_posix(), set()).add(_short(path.name) if path.suffix else "all")
    lines = [f"- `{folder}`: {', '.join(sorted(names))}" for folder, names in sorted(files.items())]
    table = "\n".join(["", *lines, "", ""])
    return _LIST.sub(lambda _: table, PAGE.read_text(encoding="utf-8"))


def _short(name: str) -> str:
    return name.removeprefix("test_").removesuffix(".py")
