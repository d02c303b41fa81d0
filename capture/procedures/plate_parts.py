"""Flat field and lights from sets of a white sheet, with records of their quality."""

from collections.abc import Sequence

import numpy as np

from capture.calibration.ps4cal import MeasuredPart, stated_error
from capture.calibration.setting import Setting
from capture.sets.captured_set import CapturedSet
from classify import Calibration, InputError
from classify.base.arrays import BoolArray
from classify.calibration.calibration import CalibratedLights
from classify.calibration.plate import MeasuredPlate, measure_plate
from classify.images import ImageStack

# Figure of a flat field by which a later light image of a sheet shows another exposure.
SHEET_BRIGHTNESS = "sheet_brightness"
# Residual of a sheet above which its light is not that of LEDs with round lobes, which leave less
# than 0.1 % (classify/DECISIONS.md).
_MAX_LED_RESIDUAL = 0.002


def plate_parts(
    sets: Sequence[CapturedSet],
    calibration: Calibration,
    mask: BoolArray | None,
    source: Sequence[str],
) -> list[MeasuredPart]:
    """Measure a sheet that the camera parts of `calibration` correct."""
    first = sets[0]
    setting = first.setting
    for number, captured in enumerate(sets[1:], start=2):
        other = captured.setting
        differences = [*setting.differences(other, "dark"), *setting.differences(other, "lights")]
        if captured.metadata.full_scale != first.metadata.full_scale:
            differences.append(
                f"a full scale of {captured.metadata.full_scale:g} instead of "
                f"{first.metadata.full_scale:g}, as of another number of averaged frames"
            )
        if differences:
            raise InputError(
                f"set {number} of the sheet has {differences[0]}; capture all at one setting"
            )
    shape = first.images.shape[1:]
    if mask is not None and mask.shape != shape:
        raise InputError(
            f"the mask has {mask.shape[1]} x {mask.shape[0]} px, the sets {shape[1]} x {shape[0]}; "
            "a mask covers the same frame"
        )
    for captured in sets:
        if captured.mask is not None:
            mask = captured.mask if mask is None else mask & captured.mask
    full_scale = float(first.metadata.full_scale)
    has_ambient = all(captured.ambient is not None for captured in sets)
    at_exposure = (calibration.holding_at if has_ambient else calibration.at)(setting.exposure_ms)
    placements = [
        at_exposure.corrected(ImageStack(captured.images, captured.ambient), full_scale)
        for captured in sets
    ]
    if mask is not None:
        mask = calibration.corrected_mask(mask)
    measured = measure_plate(placements, full_scale, first.lighting, mask)
    return [
        _flat_field(measured, setting, source),
        *_lights(measured.lights, calibration, setting, source),
    ]


def near_lights_are_refuted(calibration: Calibration, parts: Sequence[MeasuredPart]) -> bool:
    """Whether a calibration has positions of lights, and the sheet in `parts` shows none."""
    lights = calibration.lights
    has_positions = lights is not None and lights.lighting.positions_px is not None
    return has_positions and all(part.name != "lights" for part in parts)


def _flat_field(measured: MeasuredPlate, setting: Setting, source: Sequence[str]) -> MeasuredPart:
    fitted = measured.flat_field
    levels = np.exp(fitted.flat_field.coefficients[:, 0, 0])
    quality = (
        f"The flat field is known to {stated_error(fitted.error, 2)}. Lights fall off by up to "
        f"{fitted.flat_field.largest_fall_off:.0%} over the frame, and differ by "
        f"{levels.max() / levels.min() - 1.0:.0%} in its middle."
    )
    figures = {
        "error_percent": 100.0 * fitted.error,
        "fall_off_percent": 100.0 * fitted.flat_field.largest_fall_off,
        "degree": float(max(fitted.degree)),
        "unused_percent": 100.0 * fitted.unused,
        "sheet_tilt_deg": float(measured.tilts_deg.max()),
        "placements": float(len(measured.tilts_deg)) if measured.is_moved else 1.0,
        SHEET_BRIGHTNESS: measured.brightness,
    }
    warnings = []
    if not measured.is_moved:
        count = len(measured.tilts_deg)
        placements = "one placement" if count == 1 else f"{count} sets, but one placement"
        warnings.append(
            f"{placements} of the sheet: its tilt is in the flat field; give a second set with the "
            "sheet rotated by 180 degrees"
        )
    if measured.no_lights_because is not None:
        warnings.append(measured.no_lights_because)
    return MeasuredPart.now(
        "flat_field", fitted.flat_field, setting, quality, figures, source, warnings
    )


def _lights(
    lights: CalibratedLights | None,
    calibration: Calibration,
    setting: Setting,
    source: Sequence[str],
) -> list[MeasuredPart]:
    if lights is None:
        return []
    assert lights.distance_errors is not None
    assert lights.lighting.positions_px is not None
    direction_deg = float(lights.direction_errors_deg.max())
    distance = float(lights.distance_errors.max())
    quality = (
        f"The positions of the lights are known to {direction_deg:.2g} degrees and "
        f"{stated_error(distance, 1)} of their distance."
    )
    distances_px = np.linalg.norm(lights.lighting.positions_px, axis=1)
    figures = {
        "direction_error_deg": direction_deg,
        "distance_error_percent": 100.0 * distance,
        "nearest_px": float(distances_px.min()),
        "farthest_px": float(distances_px.max()),
        "residual_percent": 100.0 * lights.residual,
    }
    if calibration.scale is not None:
        figures["nearest_mm"] = float(distances_px.min()) * calibration.scale.mm_per_px
        figures["farthest_mm"] = float(distances_px.max()) * calibration.scale.mm_per_px
    if lights.lobe_exponent is not None:
        figures["lobe_exponent"] = lights.lobe_exponent
    warnings = []
    if lights.residual > _MAX_LED_RESIDUAL:
        warnings.append(
            f"the light on the sheet differs by {lights.residual:.2%} from that of LEDs: the sheet "
            "may be shiny, or the lights extended; check the positions with a sphere"
        )
    return [MeasuredPart.now("lights", lights, setting, quality, figures, source, warnings)]
