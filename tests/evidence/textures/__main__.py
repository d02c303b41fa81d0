"""Measure classifiers, materials, orientation, faults and unknown textures beyond the chapter."""

import argparse
import sys
from pathlib import Path

from classify.base.errors import InputError

from .materials import material_textures
from .plan import texture_plan
from .run import reproduce_textures


def main() -> int:
    """Write the page, its pictures and CSV files."""
    options = argparse.ArgumentParser("python -m tests.evidence.textures", description=__doc__)
    options.add_argument("--out", type=Path, required=True, metavar="DIR")
    options.add_argument("--materials", type=Path, metavar="DIR", help="default: the bundled ones")
    options.add_argument("--quick", action="store_true", help="fewer textures; three minutes")
    options.add_argument("--workers", type=int)
    given = options.parse_args()
    try:
        plan = texture_plan(given.quick, material_textures(given.materials))
        print(reproduce_textures(plan, given.out, given.workers))
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
