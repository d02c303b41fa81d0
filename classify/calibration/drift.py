"""Compare a rig with its calibration, by one set of light images of a white sheet."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from classify.base.arrays import Floats
from classify.base.errors import InputError
from classify.images import ImageStack
from classify.lighting import Lighting

from .calibration import Calibration
from .drift_model import DriftModel, Explanation, Kind, PossibleCause, moved_light
from .flat_field import PlateBlocks
from .led_positions import Aim, block_sums, fit_led_positions
from .plate import check_evenness, check_sheet, is_known

_DriftKind = Kind | Literal["unexplained"]
_Status = Literal["ok", "warning", "fault"]

# Blocks along each side of the frame; changes are smooth and need no more.
_SIDE_BLOCKS = 8
# Distance of distant lights in half of the longer side; the fall-off over the frame is 0.3 %.
_FAR_DISTANCE = 1e3
# Lights are distant, at more than 50 fields of view, if their ratios vary less over the frame.
_MAX_VARIATION = 0.01
_MIN_LIGHTS = 3  # least number that `fit_led_positions` takes
# A change beyond the first value is a warning, and beyond the second a fault. At slant 45, an LED
# whose level is wrong by 10 % tilts a level part by 3 degrees, and by 15 %, 4 degrees. A light that
# is 5 degrees lower gives 8 % less light. Angles of lights are known to 0.6 degrees
# (test_drift.py). classify/README.md has the resolution of a check at other distances.
_LED_LEVEL = (0.10, 0.15)
_LIGHT_MOVED_DEG = (2.5, 4.0)
_CAMERA_SHIFT = (0.05, 0.10)  # share of the frame's longer side
_CAMERA_ROTATED_DEG = (1.0, 3.0)
_MAGNIFICATION = (0.05, 0.10)
_SHEET_TILT_DEG = (2.5, 5.0)
# A brighter or darker corner is common to all lights: it changes the albedo only.
_VIGNETTING = (0.05, math.inf)
# The brightness of white sheets differs by less than the limit of a warning. A factor that all
# lights share changes no slope. Beyond a factor of 2, noise and hot pixels differ from the
# calibration.
_BRIGHTNESS_CHANGES = (0.25, 1.0)
# Residual of the ratios of lights; 1 % tilts normals by a third of a degree.
_RESIDUALS = (0.005, 0.01)


@dataclass(frozen=True)
class _DriftCause:
    """One thing that has changed since the calibration."""

    kind: _DriftKind
    light: int | None  # index; None for a change that all lights share
    status: _Status
    finding: str  # with its values
    advice: str  # what to do


@dataclass(frozen=True, eq=False)
class Drift:
    """A rig compared with its calibration."""

    causes: tuple[_DriftCause, ...]  # beyond the limit of a warning, the worst first
    level_changes: Floats  # (N,) relative to the common change; -0.1 for 10 % less light
    brightness: float | None  # ratio to that of the calibration, over all lights; None if unknown
    sheet_tilt_deg: float
    error_deg: float  # rms tilt of a level part, solved with this calibration
    residual: float  # rms of the ratios of lights that no cause explains
    shows_moved_lights: bool  # whether a moved light or camera would show on the sheet

    @property
    def status(self) -> _Status:
        """The worst status of the causes."""
        return _worst(*(cause.status for cause in self.causes))


def plate_drift(
    stack: ImageStack,
    full_scale: float,
    calibration: Calibration,
    lighting: Lighting,
    *,
    brightness: float | None = None,
) -> Drift:
    """Compare light images of a white matt sheet with a calibration.

    `brightness` is the geometric mean of the calibration's sheet, as a share of full scale.
    """
    flat_field, lighting = calibration.flat_field, calibration.lighting_of(lighting)
    if flat_field is None:
        raise InputError("the calibration has no flat field; run ps4rig calibrate plate")
    if not len(flat_field.coefficients) == len(lighting) == len(stack.images):
        raise InputError(
            f"the calibration is of {len(lighting)} lights, the light images are of "
            f"{len(stack.images)}"
        )
    blocks = PlateBlocks.of([calibration.corrected(stack, full_scale)], full_scale)
    check_sheet(blocks, lighting)
    expected = flat_field.logarithms(blocks.x, blocks.y)
    change, x, y = _coarse_change(blocks, expected)
    change -= change.mean() if brightness is None else math.log(brightness * full_scale)
    model = DriftModel(*_led_geometry(expected, blocks, lighting), x, y)
    explanation = model.explain(change)
    check_evenness(explanation.unevenness)
    ratio = None if brightness is None else math.exp(explanation.brightness)
    causes = sorted(_causes(explanation, model, ratio), key=lambda cause: -_severity(cause.status))
    return Drift(
        tuple(causes),
        np.expm1(explanation.levels),
        ratio,
        _tilt_deg(explanation.slope),
        _error_deg(change, explanation.slope, lighting),
        explanation.residual,
        model.shows_moved_lights(math.radians(_LIGHT_MOVED_DEG[1])),
    )


def _led_geometry(
    expected: Floats, blocks: PlateBlocks, lighting: Lighting
) -> tuple[Floats, float, Aim]:
    """Positions of the LEDs, exponent and aim of their lobes, from a flat field."""
    ratios = expected - expected.mean(axis=0)
    if len(expected) < _MIN_LIGHTS or float(ratios.std(axis=(1, 2)).max()) <= _MAX_VARIATION:
        return _FAR_DISTANCE * lighting.directions, 1.0, "centre"
    usable = blocks.usable[0].astype(np.float64)
    fitted = fit_led_positions(ratios, usable, blocks.x, blocks.y)
    if is_known(fitted):
        return fitted.positions, fitted.lobe_exponent, fitted.aim
    distances = np.linalg.norm(fitted.positions, axis=1, keepdims=True)
    return distances * lighting.directions, fitted.lobe_exponent, fitted.aim


def _coarse_change(blocks: PlateBlocks, expected: Floats) -> tuple[Floats, Floats, Floats]:
    """The change of each light (N, B) in larger blocks, and their (B,) x and y."""
    usable = blocks.usable[0]
    y, x = np.meshgrid(blocks.y, blocks.x, indexing="ij")
    values = np.concatenate([blocks.logs[0] - expected, x[None], y[None]])
    weights = block_sums(usable.astype(np.float64), _SIDE_BLOCKS).ravel()
    sums = block_sums(np.where(usable, values, 0.0), _SIDE_BLOCKS).reshape(len(values), -1)
    means = sums[:, weights > 0.0] / weights[weights > 0.0]
    return means[:-2], means[-2], means[-1]


def _worst(*statuses: _Status) -> _Status:
    return max(statuses, key=_severity, default="ok")


def _severity(status: _Status) -> int:
    return ("ok", "warning", "fault").index(status)


def _status(amount: float, limits: tuple[float, float]) -> _Status:
    return "fault" if amount > limits[1] else "warning" if amount > limits[0] else "ok"


def _tilt_deg(slope: Floats) -> float:
    return math.degrees(math.atan(math.hypot(*slope)))


def _error_deg(change: Floats, slope: Floats, lighting: Lighting) -> float:
    """Rms tilt of the sheet as it would be solved, without the tilt that it has."""
    values = lighting.directions[:, 2, None] * np.exp(change)
    b = np.linalg.pinv(lighting.directions) @ values
    slopes = -b[:2] / b[2] - slope[:, None]
    return math.degrees(math.sqrt(float(np.square(np.arctan(slopes)).sum(axis=0).mean())))


def _causes(
    explanation: Explanation, model: DriftModel, brightness_ratio: float | None
) -> Iterator[_DriftCause]:
    for light, level in enumerate(np.expm1(explanation.levels)):
        status = _status(abs(level), _LED_LEVEL)
        if status != "ok":
            finding = f"light {light} gives {_more_or_less(level)} light than at the calibration"
            advice = (
                "clean or replace the LED and check its supply, then calibrate the plate again "
                "with --replace"
            )
            yield _DriftCause("led level", light, status, finding, advice)
    for cause, parameters in explanation.causes:
        if cause.kind == "light moved":
            yield from _light_moved(cause, parameters, model)
        elif cause.kind == "camera moved":
            yield from _camera_moved(parameters)
        elif cause.kind == "leds rotated":
            yield _leds_rotated(cause, parameters)
        elif cause.kind == "lens":
            yield from _lens(parameters)
    if brightness_ratio is not None:
        change = max(brightness_ratio, 1.0 / brightness_ratio) - 1.0
        status = _status(change, _BRIGHTNESS_CHANGES)
        if status != "ok":
            finding = (
                f"all lights together are {brightness_ratio:.2f} times as bright as at the "
                "calibration"
            )
            advice = "set exposure, gain and aperture as they were, and check the LEDs' supply"
            yield _DriftCause("exposure", None, status, finding, advice)
    tilt_deg = _tilt_deg(explanation.slope)
    status = _status(tilt_deg, _SHEET_TILT_DEG)
    if status != "ok":
        finding = (
            f"the sheet is tilted by {tilt_deg:.1f} degrees, or two neighbouring LEDs have drifted "
            "alike"
        )
        yield _DriftCause("sheet tilted", None, status, finding, "lay it flat, then check again")
    status = _status(explanation.residual, _RESIDUALS)
    if status != "ok":
        finding = f"lights differ by {explanation.residual:.1%}, which no single cause explains"
        advice = (
            "is it a white matt sheet without shadow or relief? Then calibrate the plate again "
            "with --replace"
        )
        yield _DriftCause("unexplained", None, status, finding, advice)


def _light_moved(
    cause: PossibleCause, parameters: Floats, model: DriftModel
) -> Iterator[_DriftCause]:
    if cause.light is None:
        return
    before = model.positions[cause.light]
    after = moved_light(before, parameters)
    cosine = before @ after / (np.linalg.norm(before) * np.linalg.norm(after))
    angle_deg = math.degrees(math.acos(min(float(cosine), 1.0)))
    # A change of the distance counts as the angle that changes the gradient of the light as much.
    distance_as_deg = math.degrees(abs(float(parameters[2])))
    status = _status(max(angle_deg, distance_as_deg), _LIGHT_MOVED_DEG)
    if status != "ok":
        distance_change = math.expm1(parameters[2])
        finding = (
            f"light {cause.light} has moved by {angle_deg:.1f} degrees, and is "
            f"{abs(distance_change):.0%} {'farther away' if distance_change > 0 else 'nearer'}"
        )
        advice = "put it back and fasten it, then calibrate the plate again with --replace"
        yield _DriftCause("light moved", cause.light, status, finding, advice)


def _camera_moved(parameters: Floats) -> Iterator[_DriftCause]:
    right, up = 0.5 * parameters[:2]  # shares of the longer side; parameters are in half of it
    rotated_deg = math.degrees(parameters[2])
    status = _worst(
        _status(math.hypot(right, up), _CAMERA_SHIFT),
        _status(abs(rotated_deg), _CAMERA_ROTATED_DEG),
    )
    if status != "ok":
        finding = (
            f"the camera has moved relative to the lights: {abs(right):.0%} of the frame to the "
            f"{'right' if right > 0.0 else 'left'}, {abs(up):.0%} {'up' if up > 0.0 else 'down'}, "
            f"rotated by {abs(rotated_deg):.1f} degrees {'anti' * (rotated_deg > 0.0)}clockwise"
        )
        advice = "put it back and fasten it, then calibrate the plate again with --replace"
        yield _DriftCause("camera moved", None, status, finding, advice)


def _leds_rotated(cause: PossibleCause, parameters: Floats) -> _DriftCause:
    # Clockwise relative to the camera, which is the cause in the model.
    degrees = (90.0 * cause.quarter_turns + math.degrees(parameters[2]) + 180.0) % 360.0 - 180.0
    finding = (
        f"the LEDs are rotated by {abs(degrees):.0f} degrees {'anti' * (degrees < 0.0)}clockwise "
        "relative to the camera, or their plugs are exchanged"
    )
    advice = "put the LEDs back as they were, or calibrate the plate again with --replace"
    return _DriftCause("leds rotated", None, "fault", finding, advice)


def _lens(parameters: Floats) -> Iterator[_DriftCause]:
    magnification = math.exp(parameters[0])
    corner = math.expm1(parameters[1] + parameters[2])
    status = _worst(
        _status(abs(magnification - 1.0), _MAGNIFICATION), _status(abs(corner), _VIGNETTING)
    )
    if status != "ok":
        finding = (
            f"another lens, aperture or working distance: {magnification:.2f} times the "
            f"magnification, corners {_more_or_less(corner)} bright"
        )
        advice = "use the lens of the calibration, or calibrate plate and scale with --replace"
        yield _DriftCause("lens", None, status, finding, advice)


def _more_or_less(change: float) -> str:
    return f"{abs(change):.0%} {'more' if change > 0.0 else 'less'}"
