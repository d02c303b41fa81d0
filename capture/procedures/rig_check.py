"""Compare a rig with its calibration by light images of a white sheet.

The doctor, the start of a session and the start of a station make these checks.
"""

from __future__ import annotations

from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from capture.calibration.lookup import OLD_DAYS, check_setting, read_calibration
from capture.calibration.ps4cal import CalibrationFile, PartRecord
from capture.calibration.setting import Setting
from classify import Lighting
from classify.calibration.dark import SAME_EXPOSURE
from classify.calibration.drift import Drift, plate_drift
from classify.images import ImageStack
from rig import Rig
from rig.doctor.check import Check, run_checks
from rig.doctor.light_images import capture_light_images

from .plate_parts import SHEET_BRIGHTNESS

_SHEET = "plate"  # a surface of the simulated rig


def check_calibration(rig: Rig, *, has_sheet: bool) -> Iterator[Check]:
    """Check an open rig against the calibration that its configuration names, if it names one."""
    if rig.config.calibration is None:
        if has_sheet:
            advice = 'measure one with ps4rig calibrate, and set calibration = "NAME.ps4cal"'
            yield Check("calibration", "unknown", "the configuration names none", advice)
        return
    path = Path(rig.config.calibration)
    file = read_calibration(path)
    check_setting(file, Setting.of_rig(rig), "this rig")
    yield _age(path, file)
    yield from _exposure(rig, file)
    if file.calibration.flat_field is None:
        advice = "run ps4rig calibrate plate"
        yield Check("sheet", "unknown", "the calibration has no flat field", advice)
    elif has_sheet or lays_sheet_down(rig):
        yield from run_checks("sheet", lambda: checks_of_drift(drift_of_rig(rig, file)))
    else:
        advice = "put a white matt sheet below the camera, and run this again with --sheet"
        yield Check("sheet", "unknown", "LEDs, lights, camera and lens were not compared", advice)


def lays_sheet_down(rig: Rig) -> bool:
    """Whether a rig puts a sheet below its camera itself: simulated ones do."""
    return rig.simulation is not None and rig.simulation.placement is not None


def drift_of_rig(rig: Rig, file: CalibrationFile) -> Drift:
    """Capture a white sheet under each light, and compare it with a calibration."""
    simulation = rig.simulation
    placement = None if simulation is None else simulation.placement
    if simulation is not None and placement is not None:
        simulation.place(placement.model_copy(update={"surface": _SHEET}))
    try:
        images = capture_light_images(rig)
    finally:
        if simulation is not None and placement is not None:
            simulation.place(placement)
    stack = ImageStack(images.lights, images.ambient)
    return _drift(stack, images.full_scale, rig.lighting, file, Setting.of_rig(rig))


def checks_of_drift(drift: Drift) -> Iterator[Check]:
    """Yield a check for each change since the calibration, or one that is ok without any."""
    for cause in drift.causes:
        change = cause.kind if cause.light is None else f"{cause.kind}, light {cause.light}"
        yield Check(f"drift: {change}", cause.status, cause.finding, cause.advice)
    if drift.causes:
        return
    largest = float(np.abs(drift.level_changes).max())
    moved = (
        "lights, camera and lens did not move"
        if drift.shows_moved_lights
        else "the lights are too far away to show whether one has moved"
    )
    message = (
        f"LED levels within {largest:.1%} of the calibration, the sheet is tilted by "
        f"{drift.sheet_tilt_deg:.1f} degrees; {moved}"
    )
    yield Check("sheet", "ok", message)


def _drift(
    stack: ImageStack,
    full_scale: float,
    lighting: Lighting,
    file: CalibrationFile,
    setting: Setting,
) -> Drift:
    record = file.records["flat_field"]
    brightness = record.figures.get(SHEET_BRIGHTNESS)
    if brightness is not None:
        brightness *= _exposure_ratio(record, setting)
    calibration = file.calibration.holding_at(setting.exposure_ms)
    return plate_drift(stack, full_scale, calibration, lighting, brightness=brightness)


def _exposure(rig: Rig, file: CalibrationFile) -> Iterator[Check]:
    """A warning where the sheet was measured at another exposure, which is allowed."""
    record = file.records.get("flat_field")
    setting = Setting.of_rig(rig)
    if record is None or abs(_exposure_ratio(record, setting) - 1.0) <= SAME_EXPOSURE:
        return
    message = (
        f"{setting.exposure_ms:g} ms, the sheet was measured at {record.setting.exposure_ms:g} ms"
    )
    advice = "the flat field holds; dark frames of this exposure are needed where sets use them"
    yield Check("exposure of the calibration", "warning", message, advice)


def _exposure_ratio(record: PartRecord, setting: Setting) -> float:
    """The exposure as a multiple of the calibration's; 1 if one of them is unknown."""
    before_ms, now_ms = record.setting.exposure_ms, setting.exposure_ms
    return now_ms / before_ms if before_ms and now_ms else 1.0


def _age(path: Path, file: CalibrationFile) -> Check:
    ages = {name: record.age_days(datetime.now(UTC)) for name, record in file.records.items()}
    known_days = [days for days in ages.values() if days is not None]
    parts = ", ".join(name.replace("_", " ") for name in ages)
    message = f"{path}: {parts}; the oldest was measured {max(known_days, default=0)} days ago"
    if max(known_days, default=0) > OLD_DAYS:
        return Check("calibration", "warning", message, "calibrate again")
    return Check("calibration", "ok", message)
