"""``ps4rig rig doctor``."""

from functools import partial
from typing import Annotated

import typer

from capture.base.console import reported
from capture.commands import options
from capture.commands.checks import print_checks


@reported
def doctor(
    rig: options.Rig = "rig.toml",
    has_sheet: Annotated[
        bool,
        typer.Option(
            "--sheet",
            help="A white matt sheet is below the camera: compare LEDs, lights, camera and lens "
            "with the calibration of the rig. A simulated rig does so anyway.",
        ),
    ] = False,
    as_json: options.Json = False,
) -> None:
    """Check the whole rig; print each finding, and a remedy for each fault.

    It checks ports, permissions, controller, watchdog, camera, frames, and an image under each
    LED: put a surface with relief below the camera, or a white sheet with --sheet. The exit status
    is 1 if there is a fault.
    """
    from capture.procedures.rig_check import check_calibration
    from rig.doctor.diagnosis import diagnose

    further = partial(check_calibration, has_sheet=has_sheet)
    print_checks(list(diagnose(rig, further=further)), as_json=as_json)
