"""The parts of a calibration from images of a sphere or a board, with their records."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from capture.calibration.ps4cal import CalibrationFile, MeasuredPart, stated_error
from capture.calibration.setting import PartName, Setting
from capture.sets.captured_set import CapturedSet
from capture.sets.photographs import Photographs, read_mask
from classify import Calibration
from classify.base.arrays import BoolArray
from classify.base.errors import CalibrationRejected, InputError
from classify.calibration.calibration import Scale
from classify.calibration.checkerboard import MEASURABLE_TILT_DEG, find_corners, scale_of_boards
from classify.calibration.spheres import (
    SphereImages,
    SphereKind,
    SphereLights,
    lights_from_spheres,
    scale_of_spheres,
)
from classify.images import ImageStack

# Errors of directions that the record calls good and fair: the aims with a mirror sphere and with a
# matt one. Four degrees of slant rotate the normals by three (tests/evidence/calibration).
_GOOD_DEG, _FAIR_DEG = 0.5, 2.0
_IMAGE_PARTS: tuple[PartName, ...] = ("dark", "response", "scale", "flat_field")


def images_of_photographs(
    photographs: Photographs, masks: Sequence[Path], lights: int | None, file: CalibrationFile
) -> tuple[list[SphereImages], Setting]:
    """Return the images of a sphere by placement, corrected, and their setting.

    A placement has `lights` photographs, or all of them if None. There is a mask for each
    placement, or none.
    """
    lights = lights or len(photographs.planes)
    if len(photographs.planes) % lights:
        raise InputError(
            f"{len(photographs.planes)} photographs of a sphere for {lights} lights; give one "
            "photograph per light, and all lights again for each further placement. A mask goes "
            "after --mask"
        )
    count = len(photographs.planes) // lights
    if len(masks) not in (0, count):
        raise InputError(
            f"{len(masks)} masks for {count} placements of the sphere; give one each, or none"
        )
    planes = np.stack(photographs.planes)
    frame, orientation = photographs.frame, photographs.orientation
    areas: list[BoolArray | None] = [None] * count
    if masks:
        areas = [read_mask(mask, frame, None, orientation) for mask in masks]
    placements = [
        SphereImages(
            planes[lights * number : lights * (number + 1)], photographs.full_scale, mask=area
        )
        for number, area in enumerate(areas)
    ]
    setting = Setting.of_photographs(
        photographs.planes[0].shape, photographs.bit_depth, photographs.gamma
    )
    return [_corrected(placement, setting, file) for placement in placements], setting


def images_of_sets(sets: Sequence[CapturedSet], file: CalibrationFile) -> list[SphereImages]:
    """Return the images of sets of a sphere, corrected for a calibrated camera."""
    return [
        _corrected(
            SphereImages(
                captured.images, captured.metadata.full_scale, captured.ambient, captured.mask
            ),
            captured.setting,
            file,
        )
        for captured in sets
    ]


def _corrected(sphere: SphereImages, setting: Setting, file: CalibrationFile) -> SphereImages:
    """Correct light images by the calibration, and by the vignetting of its flat field."""
    # Vignetting would change the directions from a matt sphere.
    parts = {
        name: getattr(file.calibration, name)
        for name in _IMAGE_PARTS
        if name in file.records and not file.differences(name, setting)
    }
    calibration, full_scale = Calibration(**parts).at(setting.exposure_ms), sphere.full_scale
    stack = calibration.corrected(ImageStack(sphere.images, sphere.ambient), full_scale)
    if calibration.flat_field is not None:
        shared = calibration.flat_field.shared
        stack = shared.divide(stack, full_scale)
        full_scale = float(shared.saturation(full_scale))
    mask = None if sphere.mask is None else calibration.corrected_mask(sphere.mask)
    vignetting = None if calibration.flat_field is None else 0.0
    return SphereImages(stack.images, full_scale, stack.ambient, mask, vignetting)


def sphere_parts(
    placements: Sequence[SphereImages],
    kind: SphereKind,
    file: CalibrationFile,
    setting: Setting,
    source: Sequence[str],
    diameter_mm: float | None = None,
) -> list[MeasuredPart]:
    """Measure the lights, and the scale where the diameter of the sphere is known."""
    scale = file.calibration.scale
    focal_px = None if scale is None else scale.focal_px
    fit = lights_from_spheres(placements, kind, focal_px=focal_px)
    lighting = fit.lights.lighting
    if not setting.light_directions:
        rows = tuple((x, y, z) for x, y, z in lighting.directions.tolist())
        setting = setting.model_copy(update={"light_directions": rows})
    parts = [_lights_part(fit, kind, focal_px, setting, source)]
    if diameter_mm is not None:
        measured = scale_of_spheres(fit.spheres, diameter_mm)
        if scale is not None:  # the lens parameters are kept
            measured = replace(scale, mm_per_px=measured.mm_per_px, error=measured.error)
        parts.append(_scale_part(measured, fit, diameter_mm, setting, source))
    return parts


def _lights_part(
    measured: SphereLights,
    kind: SphereKind,
    focal_px: float | None,
    setting: Setting,
    source: Sequence[str],
) -> MeasuredPart:
    lights = measured.lights
    worst_deg = float(lights.direction_errors_deg.max())
    radius_px = float(np.mean([sphere.radius_px for sphere in measured.spheres]))
    outline_px = max(sphere.error_px for sphere in measured.spheres)
    grade = "Good" if worst_deg <= _GOOD_DEG else "Fair" if worst_deg <= _FAIR_DEG else "Poor"
    quantity = "directions" if lights.lighting.positions_px is None else "positions"
    quality = (
        f"{grade}: {quantity} of {len(lights.lighting)} lights to "
        f"{float(np.median(lights.direction_errors_deg)):.2g} degrees, the least certain to "
        f"{worst_deg:.2g}, from a {kind} sphere {2 * radius_px:.0f} px across."
    )
    if worst_deg > _FAIR_DEG:
        quality += (
            " A larger image of the sphere, a background that its outline stands out from, or a "
            "mask makes it better."
        )
    figures = {
        "direction_error_deg": float(np.median(lights.direction_errors_deg)),
        "largest_direction_error_deg": worst_deg,
        "sphere_radius_px": radius_px,
        "outline_error_px": outline_px,
        "outline_seen": min(measured.outline_scores),
        "residual": lights.residual,
        "placements": float(len(measured.spheres)),
    }
    if lights.distance_errors is not None:
        figures["largest_distance_error"] = float(lights.distance_errors.max())
    warnings = [*measured.doubts]
    if len(measured.spheres) > 1 and lights.lighting.positions_px is None:
        warnings.append(
            "the lights are too far away, or the placements too close together, for their "
            "distances: they count as distant"
        )
    if focal_px is None and not setting.simulated:
        warnings.append(
            "the camera counts as far away: one at 20 radii of the sphere turns a light at slant "
            "45 by 1.1 degrees towards the edge. ps4rig calibrate scale with three tilted "
            "placements of a checkerboard measures its distance"
        )
    return MeasuredPart.now("lights", lights, setting, quality, figures, source, warnings)


def _scale_part(
    scale: Scale,
    measured: SphereLights,
    diameter_mm: float,
    setting: Setting,
    source: Sequence[str],
) -> MeasuredPart:
    quality = (
        f"{'Good' if scale.error <= 0.005 else 'Fair'}: {scale.mm_per_px:.5g} mm per px, known to "
        f"{stated_error(scale.error, 1)}, from a sphere of {diameter_mm:g} mm."
    )
    figures = {
        "mm_per_px": scale.mm_per_px,
        "error": scale.error,
        "diameter_px": 2.0 * float(np.mean([sphere.radius_px for sphere in measured.spheres])),
    }
    return MeasuredPart.now("scale", scale, setting, quality, figures, source)


# Relative errors of a length that the record calls good and fair.
_GOOD, _FAIR = 0.002, 0.01
# Share of the way to the frame's corners that the board should reach to show distortion.
_MIN_COVERED_SHARE = 0.6


def scale_part(
    pictures: Sequence[npt.NDArray[np.generic]],
    corners: tuple[int, int],
    square_mm: float,
    setting: Setting,
    source: Sequence[str],
) -> MeasuredPart:
    """Measure the scale from one picture per placement of a checkerboard."""
    boards = []
    for number, picture in enumerate(pictures, start=1):
        try:
            boards.append(find_corners(picture, corners))
        except CalibrationRejected as error:
            prefix = f"placement {number}: " if len(pictures) > 1 else ""
            raise CalibrationRejected(f"{prefix}{error}") from error
    fit = scale_of_boards(boards, corners, square_mm, (setting.height_px, setting.width_px))
    scale = fit.scale
    grade = "Good" if scale.error <= _GOOD else "Fair" if scale.error <= _FAIR else "Poor"
    lens = (
        f"the lens moves pixels by up to {fit.distortion_px:.1f} px, which is corrected"
        if scale.distortion is not None
        else "no distortion of the lens beyond half a pixel is seen"
    )
    length_error = stated_error(scale.error, 2)
    quality = f"{grade}: {scale.mm_per_px:.5g} mm per px, known to {length_error}; {lens}."
    if scale.error > _FAIR:
        quality += " Lay the board flat where the part will be, and let it fill the frame."
    figures = {
        "mm_per_px": scale.mm_per_px,
        "error": scale.error,
        "residual_px": scale.residual_px,
        "distortion_px": fit.distortion_px,
        "smallest_tilt_deg": float(fit.tilts_deg.min()),
        "frame_covered": fit.covered,
        "placements": float(len(boards)),
    }
    if scale.focal_px is not None and scale.focal_error is not None:
        figures |= {"focal_length_px": scale.focal_px, "focal_error": scale.focal_error}
    warnings = []
    if fit.tilts_deg.min() > MEASURABLE_TILT_DEG:
        warnings.append(
            f"the board is tilted by {fit.tilts_deg.min():.1f} degrees; its scale is that along "
            "the axis of the tilt"
        )
    if fit.covered < _MIN_COVERED_SHARE:
        warnings.append(
            f"the board reaches {fit.covered:.0%} of the way to the corners of the frame; what "
            "the lens does farther out is not seen"
        )
    return MeasuredPart.now("scale", scale, setting, quality, figures, source, warnings)
