"""Measurement of calibrated rigs, and its files."""

import tempfile
from pathlib import Path
from typing import get_args

from capture.base.console import progress
from capture.chapter.output import PageInfo, write_page
from classify.base.durable_file import make_folder
from classify.calibration.spheres import SphereKind

from .exhibits import calibration_exhibits
from .lights import light_errors, sphere_errors
from .normal_errors import SURFACES, step_errors
from .procedures import calibrated
from .rigs import Conditions

# The outline of a ball needs more pixels.
SIZE_PX, SPHERES_PX = 256, 512
RIGS = tuple(
    Conditions(fields, bits, gamma, SIZE_PX)
    for bits, gamma in ((12, 1.0), (8, 2.2))
    for fields in (5.0, 2.0)
)
SPHERE_RIGS = tuple(Conditions(fields, 12, 1.0, SPHERES_PX) for fields in (None, 5.0))


def reproduce_calibration(output: Path) -> Path:
    """Calibrate rigs with faults, solve surfaces captured with them, and write all files.

    Returns the page. The last rig is that of the maps.

    Raises
    ------
    InputError
        If `output` cannot be made.
    """
    make_folder(output)
    with tempfile.TemporaryDirectory(dir=output, prefix=".calibrations-") as folder:
        paths = {
            each: Path(folder) / f"{number}.ps4cal"
            for number, each in enumerate((*RIGS, *SPHERE_RIGS))
        }
        files = {
            each: calibrated(each, path)
            for each, path in progress(list(paths.items()), len(paths), "calibrate")
        }
    errors = [
        step_errors(each, files[each].calibration) for each in progress(RIGS, len(RIGS), "solve")
    ]
    balls = [(kind, each) for kind in get_args(SphereKind) for each in SPHERE_RIGS]
    lights = [
        *(light_errors(each, found) for each in RIGS if (found := files[each].calibration.lights)),
        *(
            sphere_errors(kind, each, files[each])
            for kind, each in progress(balls, len(balls), "spheres")
        ),
    ]
    facts = {
        "rigs": "; ".join(f"LEDs at {each.fields:g} fields, {each.camera}" for each in RIGS),
        "surfaces": ", ".join(SURFACES),
        "frames": f"{SIZE_PX} px, of spheres {SPHERES_PX} px",
    }
    exhibits = list(calibration_exhibits(errors, lights))
    info = PageInfo("calibration", Path(__file__).with_name("page.html"), simulated=True)
    return write_page(exhibits, facts, info, output)
