"""Write the reference, `python -m tests.reference`; `--check` only compares it.

The pages are made from the code: a key, an option or a code is described where it is defined.
"""

import sys
from collections.abc import Callable
from pathlib import Path

from rig import RigConfig

from .commands import commands_page
from .files import files_page
from .keys import sections
from .promises import PAGE, page_with_table
from .station import station_page

FOLDER = Path(__file__).parents[2] / "reference"
PAGES: dict[str, Callable[[], str]] = {
    "commands.md": commands_page,
    "rig.md": lambda: "\n".join(["# rig.toml", "", *sections(RigConfig)]),
    "files.md": files_page,
    "station.md": station_page,
}


def outdated() -> list[str]:
    """Return the names of pages that differ from the code, and of files that are no pages."""
    present = {each.name: each.read_text(encoding="utf-8") for each in FOLDER.iterdir()}
    made = {name: f"{page()}\n" for name, page in PAGES.items()}
    other = [] if page_with_table() == PAGE.read_text(encoding="utf-8") else ["tests/README.md"]
    return sorted({name for name, _ in present.items() ^ made.items()}) + other


def main() -> None:
    """Write all pages, and the table of promises."""
    PAGE.write_text(page_with_table(), encoding="utf-8")
    for name, page in PAGES.items():
        (FOLDER / name).write_text(f"{page()}\n", encoding="utf-8")
        print(f"{FOLDER.name}/{name}: {(FOLDER / name).stat().st_size / 1e3:.1f} kB")


if __name__ == "__main__":
    sys.exit(main())
