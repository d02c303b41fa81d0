"""Measure which simulated defects a defect map finds: tables beside other detectors."""

import argparse
import sys
from pathlib import Path

from classify.base.errors import InputError
from tests.evidence.textures.materials import material_textures

from .plan import defect_plan
from .run import reproduce_defects


def main() -> int:
    """Write the page, its pictures and CSV files."""
    options = argparse.ArgumentParser("python -m tests.evidence.defects", description=__doc__)
    options.add_argument("--out", type=Path, required=True, metavar="DIR")
    options.add_argument("--materials", type=Path, metavar="DIR", help="default: the bundled ones")
    options.add_argument("--quick", action="store_true", help="six textures; a minute")
    options.add_argument("--workers", type=int)
    given = options.parse_args()
    try:
        plan = defect_plan(given.quick, material_textures(given.materials))
        print(reproduce_defects(plan, given.out, given.workers))
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
