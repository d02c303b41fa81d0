"""Judge solvers on photographs: `python -m tests.evidence.photographs DIR --out OUT`.

photograph_set -> a folder of photographs with lights.json; picks of four lights near a ring
scores         -> one pick solved by each method, and the errors
recognition    -> patches of the objects, matched with and without their object taught
exhibits       -> tables and pictures
run            -> the page and its files
"""

import argparse
import sys
from pathlib import Path

from classify.base.errors import InputError

from .run import reproduce_photographs


def main() -> int:
    """Write the page, its pictures and CSV files."""
    options = argparse.ArgumentParser(
        "python -m tests.evidence.photographs",
        description="Judge solvers by the photographs of lights that they did not use.",
    )
    options.add_argument("folder", type=Path, metavar="DIR", help="a folder for each object")
    options.add_argument("--out", type=Path, required=True, metavar="OUT")
    given = options.parse_args()
    try:
        print(reproduce_photographs(given.folder, given.out))
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
