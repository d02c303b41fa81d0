"""Whether a new part of a calibration may replace the present part."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from datetime import UTC, datetime

import numpy as np

from classify.base.errors import CalibrationRejected
from classify.calibration.calibration import CalibratedLights, Response, Scale
from classify.calibration.dark import Dark, measured_at
from classify.calibration.photon_transfer import Noise
from classify.lighting import angles_between_deg
from classify.lights.flat_field import FlatField

from .lookup import OLD_DAYS
from .ps4cal import CalibrationFile, MeasuredPart
from .setting import PartName

# Standard errors from which a difference counts as real; normal errors reach 3 once in 370 times.
_STANDARD_ERRORS = 3.0
# Ratio of the errors of two parts up to which they count as equal. An error that is estimated from
# ten residuals is itself known to 20 %.
_MAX_ERROR_RATIO = 1.25
# Smallest differences that count. They cover what standard errors do not: errors of a target and of
# its place, such as a board 10 mm too high at 1 m, and lights that have warmed up.
_FLOOR_SCALE, _FLOOR_FOCAL, _FLOOR_DISTANCE = 0.01, 0.02, 0.03
_FLOOR_DIRECTION_DEG = 1.0
_FLOOR_FLAT_FIELD, _FLOOR_RESPONSE = 0.05, 0.02
_FLOOR_GAIN, _FLOOR_NOISE, _FLOOR_OFFSET = 0.05, 0.25, 0.005
_POSITIONS = "positions"  # of near lights, whose directions change over the frame
# Points along each side of the frame at which flat fields are compared.
_COMPARED_POINTS = 9


@dataclass(frozen=True)
class _Difference:
    """A difference between two parts in one quantity."""

    text: str
    size: float
    limit: float  # largest size that the errors of the parts explain
    unit: str = "%"

    def __str__(self) -> str:
        factor = 100.0 if self.unit == "%" else 1.0
        return (
            f"{self.text} ({factor * self.size:.3g} {self.unit} apart, the errors allow "
            f"{factor * self.limit:.2g} {self.unit})"
        )


def reason_to_keep(file: CalibrationFile, new: MeasuredPart) -> str | None:
    """Say why the part of a calibration is better than a new one; None if it is not.

    A new part that contradicts the present one raises `CalibrationRejected`.
    """
    present = _present_part(file, new)
    if present is None:
        return None
    for difference in _DIFFERENCES[new.name](present, new):
        if difference.size > difference.limit:
            raise CalibrationRejected(
                f"{file.path}: {new.name.replace('_', ' ')}: {difference}, measured "
                f"{present.record.date}; check the target and its size, or take the new "
                "measurement with --replace"
            )
    if (present.record.age_days(datetime.now(UTC)) or 0) > OLD_DAYS:
        return None
    if (extra := _advantage(present, new)) is not None:
        return f"it has {extra}, which the new one lacks"
    present_error, new_error = (_ERRORS[new.name](part) for part in (present, new))
    limit = max(_MAX_ERROR_RATIO * present_error, _NEGLIGIBLE_ERRORS[new.name])
    if new_error <= limit or _advantage(new, present) == _POSITIONS:
        return None
    return f"its error is {present_error:.2g}, that of the new one {new_error:.2g}"


def with_other_exposures(new: MeasuredPart, file: CalibrationFile) -> MeasuredPart:
    """Return a dark part with the exposures that a calibration has at its camera setting."""
    dark = file.calibration.dark
    if new.name != "dark" or dark is None or not _has_camera_setting_of_dark(file, new):
        return new
    merged: Dark = dark.with_exposure_of(new.part)
    shortest, longest = merged.exposures[0], merged.exposures[-1]
    if shortest.exposure_ms is None or longest.exposure_ms is None or merged.longer is None:
        return new
    range_ms = longest.exposure_ms - shortest.exposure_ms
    present_record = file.records["dark"]
    figures = {
        "exposures": float(len(merged.exposures)),
        "shortest_ms": shortest.exposure_ms,
        "longest_ms": longest.exposure_ms,
        "dark_current_dn_per_s": 1e3 * (longest.offset - shortest.offset) / range_ms,
    }
    quality = f"Dark frames {measured_at(merged)}. At {new.part.exposure_ms:g} ms: "
    changes = {
        "date": min(present_record.date, new.record.date),
        "quality": quality + new.record.quality,
        "figures": new.record.figures | figures,
        "source": tuple(dict.fromkeys((*present_record.source, *new.record.source))),
    }
    return replace(new, part=merged, record=new.record.model_copy(update=changes))


def _present_part(file: CalibrationFile, new: MeasuredPart) -> MeasuredPart | None:
    """The present part that a new one would replace; None if it does not hold at its setting."""
    if new.name not in file.records:
        return None
    part, record = getattr(file.calibration, new.name), file.records[new.name]
    if new.name == "dark":
        matching = (dark for dark in part.exposures if dark.holds_at(new.part.exposure_ms))
        part = next(matching, None) if _has_camera_setting_of_dark(file, new) else None
        return None if part is None else MeasuredPart(new.name, part, record)
    is_outdated = new.name in file.outdated_parts or file.differences(new.name, new.record.setting)
    return None if is_outdated else MeasuredPart(new.name, part, record)


def _has_camera_setting_of_dark(file: CalibrationFile, new: MeasuredPart) -> bool:
    """Whether a dark part differs from that of a calibration at most in its exposure."""
    any_exposure = file.records["dark"].setting.model_copy(update={"exposure_ms": None})
    return not any_exposure.differences(new.record.setting, "dark")


def _limit(floor: float, *errors: float) -> float:
    return max(floor, _STANDARD_ERRORS * math.hypot(*errors))


def _relative_change(present: float, measured: float) -> float:
    """Difference of two positive values as a share."""
    return math.expm1(abs(math.log(measured / present)))


def _scale(present: MeasuredPart, measured: MeasuredPart) -> Iterator[_Difference]:
    before: Scale = present.part
    now: Scale = measured.part
    yield _Difference(
        f"{now.mm_per_px:.5g} mm per px instead of {before.mm_per_px:.5g}",
        _relative_change(before.mm_per_px, now.mm_per_px),
        _limit(_FLOOR_SCALE, before.error, now.error),
    )
    if before.focal_px and now.focal_px:
        yield _Difference(
            f"a focal length of {now.focal_px:.5g} px instead of {before.focal_px:.5g}",
            _relative_change(before.focal_px, now.focal_px),
            _limit(_FLOOR_FOCAL, before.focal_error or 0.0, now.focal_error or 0.0),
        )


def _lights(present: MeasuredPart, measured: MeasuredPart) -> Iterator[_Difference]:
    before: CalibratedLights = present.part
    now: CalibratedLights = measured.part
    angles_deg = angles_between_deg(before.lighting.directions, now.lighting.directions)
    errors_deg = zip(before.direction_errors_deg, now.direction_errors_deg, strict=True)
    positions_before, positions_now = before.lighting.positions_px, now.lighting.positions_px
    floors_deg = np.full(len(angles_deg), _FLOOR_DIRECTION_DEG)
    positions = positions_now if positions_before is None else positions_before
    if positions is not None and (positions_before is None or positions_now is None):
        # A direction without a position is measured at the sphere, above the plane of the part.
        half_px = 0.5 * max(present.record.setting.width_px, present.record.setting.height_px)
        parallax = np.arctan(half_px / np.linalg.norm(positions, axis=1))
        floors_deg = np.maximum(floors_deg, np.degrees(parallax))
    for light, (angle_deg, errors) in enumerate(zip(angles_deg, errors_deg, strict=True)):
        limit_deg = _limit(floors_deg[light], *errors)
        yield _Difference(f"light {light} in another direction", angle_deg, limit_deg, "degrees")
    if positions_before is None or positions_now is None:
        return
    assert before.distance_errors is not None
    assert now.distance_errors is not None
    distances = np.linalg.norm(positions_before, axis=1), np.linalg.norm(positions_now, axis=1)
    for light, (first_px, second_px) in enumerate(zip(*distances, strict=True)):
        limit = _limit(_FLOOR_DISTANCE, before.distance_errors[light], now.distance_errors[light])
        text = f"light {light} at {second_px:.4g} px instead of {first_px:.4g}"
        yield _Difference(text, _relative_change(first_px, second_px), limit)


def _flat_field(present: MeasuredPart, measured: MeasuredPart) -> Iterator[_Difference]:
    setting = present.record.setting
    longer = max(setting.width_px, setting.height_px)
    x, y = (
        np.linspace(-side / longer, side / longer, _COMPARED_POINTS)
        for side in (setting.width_px, setting.height_px)
    )
    before: FlatField = present.part
    now: FlatField = measured.part
    changes = now.logarithms(x, y) - before.logarithms(x, y)
    changes -= np.median(changes)  # a change of the exposure
    errors = [part.figure("error_percent") / 100.0 for part in (present, measured)]
    for light, change in enumerate(np.abs(changes).max(axis=(1, 2)).tolist()):
        limit = _limit(_FLOOR_FLAT_FIELD, *errors)
        yield _Difference(f"light {light} of another strength", math.expm1(change), limit)


def _response(present: MeasuredPart, measured: MeasuredPart) -> Iterator[_Difference]:
    before: Response = present.part
    now: Response = measured.part
    size = float(np.abs(now.curve - before.curve).max())
    yield _Difference("another curve", size, _limit(_FLOOR_RESPONSE, before.error, now.error))


def _noise(present: MeasuredPart, measured: MeasuredPart) -> Iterator[_Difference]:
    before: Noise = present.part
    now: Noise = measured.part
    gains = before.sensor.gain_e_per_dn, now.sensor.gain_e_per_dn
    errors = [part.figure("gain_error_share") for part in (present, measured)]
    text = f"{gains[1]:.4g} electrons per pixel value instead of {gains[0]:.4g}"
    yield _Difference(text, _relative_change(*gains), _limit(_FLOOR_GAIN, *errors))
    noises = before.sensor.read_noise_dn, now.sensor.read_noise_dn
    scale = max(*noises, 1.0)
    errors = [part.figure("read_noise_error_dn") / scale for part in (present, measured)]
    text = f"a read noise of {noises[1]:.3g} instead of {noises[0]:.3g}"
    size = abs(noises[1] - noises[0]) / scale
    yield _Difference(text, size, _limit(_FLOOR_NOISE, *errors))


def _dark(present: MeasuredPart, measured: MeasuredPart) -> Iterator[_Difference]:
    before: Dark = present.part
    now: Dark = measured.part
    full = before.full_scale
    offset = now.offset * full / now.full_scale
    text = f"an offset of {offset:.4g} instead of {before.offset:.4g}"
    yield _Difference(text, abs(offset - before.offset) / full, _FLOOR_OFFSET)
    noise = now.noise * full / now.full_scale
    text = f"a noise of {noise:.3g} instead of {before.noise:.3g}"
    size = abs(noise - before.noise) / max(noise, before.noise, 1.0)
    yield _Difference(text, size, _FLOOR_NOISE)


_DIFFERENCES: dict[PartName, Callable[[MeasuredPart, MeasuredPart], Iterator[_Difference]]] = {
    "dark": _dark,
    "response": _response,
    "noise": _noise,
    "flat_field": _flat_field,
    "lights": _lights,
    "scale": _scale,
}
# Errors of the parts, for the comparison of two of one kind.
_ERRORS: dict[PartName, Callable[[MeasuredPart], float]] = {
    "dark": lambda part: part.figure("frames") ** -0.5 if part.figure("frames") else 0.0,
    "response": lambda part: float(part.part.error),
    "noise": lambda part: part.figure("gain_error_share"),
    "flat_field": lambda part: part.figure("error_percent") / 100.0,
    "lights": lambda part: _error_of_lights(part.part),
    "scale": lambda part: float(part.part.error),
}
# Errors too small to change the normals and lengths of a part.
_NEGLIGIBLE_ERRORS: dict[PartName, float] = {
    "dark": 0.0, "response": 5e-4, "noise": 5e-3, "flat_field": 1e-3, "lights": 2e-3, "scale": 5e-4,
}  # fmt: skip
# Extra data of a part, and whether a part has them.
_EXTRAS: dict[PartName, tuple[str, Callable[[MeasuredPart], bool]]] = {
    "scale": ("a focal length", lambda part: part.part.focal_px is not None),
    "lights": (_POSITIONS, lambda part: part.part.distance_errors is not None),
    "flat_field": (
        "two placements of the sheet",
        lambda part: part.figure("placements") > 1.0,
    ),
}


def _advantage(part: MeasuredPart, other: MeasuredPart) -> str | None:
    """Name of the extra data that `part` has and `other` lacks; None without any."""
    if part.name not in _EXTRAS:
        return None
    extra, has_extra = _EXTRAS[part.name]
    return extra if has_extra(part) and not has_extra(other) else None


def _error_of_lights(lights: CalibratedLights) -> float:
    """Largest error of a light: of its direction in radians, and of its distance as a share."""
    direction = math.radians(float(lights.direction_errors_deg.max()))
    distances = lights.distance_errors
    return math.hypot(direction, 0.0 if distances is None else float(distances.max()))
