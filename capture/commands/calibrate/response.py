"""``ps4rig calibrate response``: linearity and noise of the camera."""

from __future__ import annotations

from typing import TYPE_CHECKING

from capture.commands import options
from capture.console import progress, reported
from classify.errors import InputError

from .flow import (
    CalibrationPath,
    FromSets,
    RigToCalibrate,
    Target,
    Yes,
    calibration_at,
    keep_parts,
    place_target,
    sets_given,
)

if TYPE_CHECKING:
    from capture.calibration.ps4cal import MeasuredPart
    from classify.calibration.calibration import Calibration
    from rig import Rig

_SHEET = Target("a white matt sheet", "plate")
# At each exposure. Their differences show the noise: four give three times the freedom of two.
_FRAMES = 4


@reported
def response(
    calibration: CalibrationPath,
    rig: RigToCalibrate = None,
    given: FromSets = None,
    yes: Yes = False,
    json: options.Json = False,
) -> None:
    """Measure whether the camera is linear, by a ladder of exposures of a white sheet; its noise.

    A camera that is not linear gets the inverse of its curve. Neither the sheet nor the light of
    the room may change meanwhile. Sets of --from show one scene at six exposures or more; two sets
    of each exposure show the noise too.
    """
    from capture.calibration.camera_parts import response_parts, rungs_of_sets
    from capture.calibration.setting import Setting

    if (rig is None) == (not given):
        raise InputError("give --rig RIG to capture a ladder of exposures, or --from SET of it")
    file = calibration_at(calibration, given or ())
    if rig is None:
        sets, names = sets_given(given or [])
        rungs, full_scale = rungs_of_sets(sets, file.calibration)
        setting = Setting.of_set(sets[0])
        parts = response_parts(rungs, full_scale, file.calibration, setting, names)
    else:
        from rig import open_rig

        with open_rig(rig) as opened:
            parts = _of_rig(opened, file.calibration, yes)
    keep_parts(calibration, file, parts, json=json)


def _of_rig(rig: Rig, calibration: Calibration, yes: bool) -> list[MeasuredPart]:
    from capture.acquisition.frame_series import (
        brightest_light,
        exposure_kept,
        ladder_frames,
        ladder_ms,
        require_free_running,
    )
    from capture.calibration.camera_parts import Rung, levels_of, response_parts
    from capture.calibration.setting import Setting

    require_free_running(rig)
    full_scale = (1 << rig.camera.info.bit_depth) - 1
    setting = Setting.of_rig(rig)
    place_target(rig, _SHEET, yes=yes)
    with exposure_kept(rig):
        light = brightest_light(rig)
        exposures_ms = ladder_ms(rig, light)
        captured = ladder_frames(rig, light, exposures_ms, _FRAMES)
        rungs = [
            Rung(exposure_ms, levels_of(frames, full_scale, calibration))
            for exposure_ms, frames in progress(captured, len(exposures_ms), "exposures")
        ]
    return response_parts(rungs, full_scale, calibration, setting, ("captured",))
