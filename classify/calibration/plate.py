"""Flat field and LED positions from light images of a white matt sheet."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from classify.base.arrays import BoolArray, Floats
from classify.base.errors import CalibrationRejected, InputError
from classify.images import ImageStack
from classify.lighting import Lighting

from .calibration import CalibratedLights
from .flat_field import (
    FittedFlatField,
    PlateBlocks,
    are_moved,
    check_placements_differ,
    fit_flat_field,
)
from .led_positions import LedPositions, fit_led_positions

# Limits of the checks; "What a sheet is refused for" in classify/DECISIONS.md has the figures of
# sheets, parts and textures.
_MAX_SATURATED = 1e-3
_MIN_BRIGHTNESS = 0.05
_MIN_SHEET_SHARE, _MAX_UNUSED_SHARE = 0.125, 0.5
_MAX_RELIEF_SLOPE, _MAX_RATIO_ROUGHNESS, _MAX_UNEVENNESS = 0.08, 0.02, 0.03
_MAX_GLOSS_EXCESS, _MAX_SIDE_SHARE, _MAX_SHINY_SHARE = 0.01, 0.2, 0.6
# Largest tilt of a sheet by three estimates: the change of the lights when it is rotated, the
# difference of measured and configured lights, and the levels of distant lights (10 % are 6
# degrees).
_MAX_TILT_DEG, _MAX_TILT_ALONE_DEG, _MAX_TILT_BY_LEVELS_DEG = 4.0, 7.0, 12.0
# A tilt explains differences of directions, or of levels, if it leaves at most this share of them.
_MAX_UNEXPLAINED_DIRECTIONS, _MAX_UNEXPLAINED_LEVELS = 0.5, 0.05
# Positions with larger standard errors are no better than the configured directions. An error of
# 20 % in the distance changes normals less than an error of 3 degrees in the direction does.
_MAX_DIRECTION_ERROR_DEG, _MAX_DISTANCE_ERROR = 3.0, 0.2
# Largest residual of the model of LEDs: sheets have 0.03 %, the photographs `gelsight_groove6`
# have 0.8 %, a broad highlight of 30 % has 2.8 %.
_MAX_RESIDUAL = 0.015
# cos(88 degrees): no solver can use lights below this elevation.
_MIN_LIGHT_Z = 0.035
# Assumed tilt of a sheet on a table; share of it that two placements 180 +- 10 degrees apart leave;
# assumed tilt of a single placement.
_TABLE_DEG, _REMAINING_TILT = 0.3, 0.17
_SINGLE_TILT_DEG = 1.0
_COMMANDS_TO_REPEAT = "ps4rig calibrate dark, which adds the exposure, and this command"


@dataclass(frozen=True, eq=False)
class MeasuredPlate:
    """Flat field and lights of a rig, from S placements of a sheet."""

    flat_field: FittedFlatField
    lights: CalibratedLights | None  # with positions; None where the ratios do not give them
    no_lights_because: str | None
    tilts_deg: Floats  # (S,) of the sheet from the mean of all placements
    brightness: float  # geometric mean of the pixel values, as a share of full scale
    is_moved: bool  # between placements; if not, they count as one


def measure_plate(
    placements: Sequence[ImageStack],
    full_scale: float,
    lighting: Lighting,
    mask: BoolArray | None = None,
) -> MeasuredPlate:
    """Measure flat field and LED positions on a white matt sheet in the (H, W) `mask`."""
    if len(lighting) < 3:
        raise InputError(f"{len(lighting)} lights; a sheet shows the positions of three or more")
    shapes = {placement.images.shape for placement in placements}
    if len(shapes) != 1 or next(iter(shapes))[0] != len(lighting):
        raise InputError(
            f"the sets of the sheet differ in size or in lights: shapes {sorted(shapes)} for "
            f"{len(lighting)} lights; capture them alike"
        )
    check_placements_differ([placement.images for placement in placements])
    blocks = PlateBlocks.of(placements, full_scale, mask)
    check_sheet(blocks, lighting)
    fitted = fit_flat_field(blocks)
    positions = fit_led_positions(fitted.ratios, fitted.weights, blocks.x, blocks.y)
    unit_px = 0.5 * max(blocks.shape)
    measured = Lighting.near(positions.positions * unit_px) if is_known(positions) else None
    tilts_deg, _ = _tilts_deg(fitted.offsets, measured or lighting)
    common_deg = _checked_tilt_deg(tilts_deg, fitted, measured, lighting)
    _check_gloss(positions, blocks, measured or lighting)
    _check_surface(fitted)
    logs = np.moveaxis(blocks.logs, 1, -1)[blocks.usable]
    brightness = float(np.exp(logs.mean())) / full_scale
    is_moved = are_moved(blocks, fitted.flat_field)
    if measured is None:
        reason = _why_unknown(positions)
        return MeasuredPlate(fitted, None, reason, tilts_deg, brightness, is_moved)
    if is_moved:
        levelling_error_deg = np.hypot(_TABLE_DEG, _REMAINING_TILT * tilts_deg.max())
    else:
        levelling_error_deg = np.hypot(_SINGLE_TILT_DEG, common_deg)
    lights = CalibratedLights(
        measured, "plate", np.hypot(positions.direction_errors_deg, levelling_error_deg),
        positions.distance_errors, positions.residual, positions.lobe_exponent,
    )  # fmt: skip
    return MeasuredPlate(fitted, lights, None, tilts_deg, brightness, is_moved)


def check_sheet(blocks: PlateBlocks, lighting: Lighting) -> None:
    """Reject light images that are saturated, too dark, or of something with relief."""
    _check_exposure(blocks)
    slopes = blocks.relief[blocks.usable] / np.tan(np.radians(lighting.slants_deg)).mean()
    if np.median(slopes) > _MAX_RELIEF_SLOPE:
        raise CalibrationRejected(
            f"not a white matt sheet: it has relief of rms slope {np.median(slopes):.2f}, a sheet "
            f"less than {_MAX_RELIEF_SLOPE:g}; put paper or a matt board below the camera"
        )


def check_evenness(residual: float) -> None:
    """Reject a sheet whose mean brightness departs from a smooth fit by this share."""
    if residual > _MAX_UNEVENNESS:
        raise CalibrationRejected(
            f"not a white sheet: its reflectance varies by {residual:.1%} over the frame; use "
            "blank paper"
        )


def _check_exposure(blocks: PlateBlocks) -> None:
    placement, light = np.unravel_index(blocks.saturated.argmax(), blocks.saturated.shape)
    share = blocks.saturated[placement, light]
    if share > _MAX_SATURATED:
        raise CalibrationRejected(
            f"light {light} saturates {share:.1%} of the sheet; lower camera.exposure_ms in "
            f"rig.toml, or the level of LED {light} (simulation.led_levels of a simulated rig); "
            f"then repeat {_COMMANDS_TO_REPEAT}"
        )
    placement, light = np.unravel_index(blocks.levels.argmin(), blocks.levels.shape)
    level = blocks.levels[placement, light]
    if level < _MIN_BRIGHTNESS:
        raise CalibrationRejected(
            f"too dark: the sheet reaches {level:.1%} of full scale under light {light}; raise "
            f"camera.exposure_ms in rig.toml until it reaches {_MIN_BRIGHTNESS:.0%} or more, then "
            f"repeat {_COMMANDS_TO_REPEAT}"
        )
    share = blocks.usable.mean(axis=(1, 2)).min()
    if share < _MIN_SHEET_SHARE:
        raise CalibrationRejected(
            f"only {share:.0%} of the frame shows the sheet; let it fill the frame"
        )


def is_known(positions: LedPositions) -> bool:
    """Whether fitted positions are better than directions alone."""
    heights = positions.positions[:, 2] / np.linalg.norm(positions.positions, axis=1)
    return bool(
        heights.min() >= _MIN_LIGHT_Z
        and positions.residual <= _MAX_RESIDUAL
        and positions.direction_errors_deg.max() <= _MAX_DIRECTION_ERROR_DEG
        and positions.distance_errors.max() <= _MAX_DISTANCE_ERROR
    )


def _why_unknown(positions: LedPositions) -> str:
    if positions.residual > _MAX_RESIDUAL:
        return (
            f"the light on the sheet differs by {positions.residual:.1%} from that of LEDs: the "
            "sheet is shiny, or the lights are no points; measure their directions with a sphere"
        )
    return (
        "the lights are too far away for their positions to be seen on a sheet (directions "
        f"uncertain by {min(positions.direction_errors_deg.max(), 90.0):.0f} degrees); measure "
        "their directions with a sphere"
    )


def _tilts_deg(offsets: Floats, lighting: Lighting) -> tuple[Floats, Floats]:
    """(S,) tilts of a sheet that explain (S, N) changes of log brightness, and (S, N) residuals."""
    # A sheet of slopes a is 1 - a . l_xy / l_z times as bright under a light.
    tangents = lighting.directions[:, :2] / lighting.directions[:, 2:]
    centred = tangents - tangents.mean(axis=0)
    changes = (offsets - offsets.mean(axis=1, keepdims=True)).T
    slopes = np.linalg.lstsq(-centred, changes, rcond=None)[0]
    tilts_deg = np.degrees(np.arctan(np.linalg.norm(slopes, axis=0)))
    return tilts_deg, (changes + centred @ slopes).T


def _checked_tilt_deg(
    tilts_deg: Floats, fitted: FittedFlatField, measured: Lighting | None, configured: Lighting
) -> float:
    """Check the tilts, and return the tilt that all placements share.

    It is estimated from the difference of the measured and the configured lights.
    """
    if tilts_deg.max() > _MAX_TILT_DEG:
        raise CalibrationRejected(
            f"the sheet is tilted by {tilts_deg.max():.1f} degrees; lay it flat, to "
            f"{_MAX_TILT_DEG:g} degrees"
        )
    if measured is not None:
        tilt_deg, limit_deg = _common_tilt_deg(measured, configured), _MAX_TILT_ALONE_DEG
    else:
        levels = fitted.flat_field.coefficients[:, 0, 0]
        tilt_deg = _tilt_of_levels_deg(levels - levels.mean(), configured)
        limit_deg = _MAX_TILT_BY_LEVELS_DEG
    if tilt_deg > limit_deg:
        raise CalibrationRejected(
            f"the sheet is tilted by about {tilt_deg:.0f} degrees, or the lights do not stand as "
            "configured; lay it flat, and check the tilts and slants of the lights"
        )
    return tilt_deg


def _common_tilt_deg(measured: Lighting, configured: Lighting) -> float:
    """Tilt of the sheet that explains how all directions differ; 0 if none does."""
    change = measured.directions - configured.directions
    # A small rotation w adds w x l to every direction l.
    design = np.concatenate([-_cross(direction) for direction in configured.directions])
    rotation, *_ = np.linalg.lstsq(design, change.ravel(), rcond=None)
    residual = change.ravel() - design @ rotation
    if np.square(residual).sum() > _MAX_UNEXPLAINED_DIRECTIONS * np.square(change).sum():
        return 0.0
    return float(np.degrees(np.hypot(rotation[0], rotation[1])))


def _cross(vector: Floats) -> Floats:
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def _tilt_of_levels_deg(levels: Floats, configured: Lighting) -> float:
    """Tilt of the sheet that explains the levels of distant lights; 0 if none does."""
    if len(configured) == 3:
        return 0.0  # a tilt explains any three levels
    tilts_deg, residuals = _tilts_deg(levels[None], configured)
    if np.square(residuals).sum() > _MAX_UNEXPLAINED_LEVELS * np.square(levels).sum():
        return 0.0
    return float(tilts_deg[0])


def _check_surface(fitted: FittedFlatField) -> None:
    if fitted.ratio_residual > _MAX_RATIO_ROUGHNESS or fitted.unused > _MAX_UNUSED_SHARE:
        raise CalibrationRejected(
            f"not a white matt sheet: the lights differ by {fitted.ratio_residual:.1%} from place "
            f"to place, and {fitted.unused:.0%} of the frame fits no smooth light; use a sheet, or "
            "a mask of flat areas"
        )
    check_evenness(fitted.mean_residual)


def _check_gloss(positions: LedPositions, blocks: PlateBlocks, lighting: Lighting) -> None:
    """Reject a shiny sheet, which has a highlight on the side of each light."""
    size = positions.residuals.shape[-1]
    x, y = (axis.reshape(size, -1).mean(axis=1) for axis in (blocks.x, blocks.y))
    step = len(blocks.x) // size
    usable = blocks.usable.all(axis=0).reshape(size, step, size, step).all(axis=(1, 3))
    shiny = []
    for light, excess in enumerate(positions.residuals):
        highlight = np.where(usable & (excess > _MAX_GLOSS_EXCESS), excess, 0)
        total = highlight.sum()
        towards = lighting.directions[light, :2]
        towards = towards / max(float(np.linalg.norm(towards)), 1e-9)
        moment_x, moment_y = highlight.sum(axis=0) @ x, highlight.sum(axis=1) @ y
        offset = moment_x * towards[0] + moment_y * towards[1]
        if total > 0.0 and offset / total > _MAX_SIDE_SHARE:
            shiny.append(light)
    if len(shiny) > _MAX_SHINY_SHARE * len(positions.residuals):
        raise CalibrationRejected(
            f"the sheet is shiny: a highlight of {np.expm1(positions.residuals.max()):.1%} lies on "
            f"the side of lights {', '.join(map(str, shiny))}; use matt paper"
        )
