"""Directions and positions of lights from light images of mirror or matt spheres."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Self

import numpy as np

from classify.base.arrays import Array, BoolArray, Floats
from classify.base.errors import CalibrationRejected, InputError
from classify.lighting import Lighting

from .calibration import CalibratedLights, Scale, nominal_camera_matrix
from .flat_field import check_placements_differ
from .sphere import Sphere
from .sphere_lights import SATURATED, matte_directions, mirror_directions
from .sphere_outline import find_outline, outline_of_mask

SphereKind = Literal["mirror", "matte"]

# Largest relative error of the distances of near lights; otherwise the lights count as distant.
# At five fields of view, that makes normals wrong by 10 degrees (table in classify/README.md), and
# an error of the distance by 15 % by 1.5 degrees.
_MAX_DISTANCE_ERROR = 0.15
# Condition number above which rays are parallel within the rounding of float64. It is the squared
# ratio of the errors of distance and direction: 1e8 for `_MAX_DISTANCE_ERROR` and 1e-5 rad.
_MAX_CONDITION = 1e12
# Largest usable error: four lights that are 10 degrees off tilt the normals by as much.
_MAX_ERROR_DEG = 10.0


@dataclass(frozen=True, eq=False)
class SphereImages:
    """Light images of a sphere at one place, under each light."""

    images: Array  # (N, H, W)
    full_scale: float  # value of saturation
    ambient: Array | None = None  # (H, W) with all lights off
    mask: BoolArray | None = None  # (H, W) true on the sphere; None to find it
    vignetting: float | None = None  # share of light missing in the corners; None if unknown


@dataclass(frozen=True, eq=False)
class SphereLights:
    """Lights from spheres, and what they were measured with."""

    lights: CalibratedLights
    spheres: tuple[Sphere, ...]  # one per placement
    outline_scores: tuple[float, ...]  # visible share of each outline, 0 to 1
    doubts: tuple[str, ...]  # what may be wrong, in sentences


def lights_from_spheres(
    placements: Sequence[SphereImages], kind: SphereKind, *, focal_px: float | None = None
) -> SphereLights:
    """Directions of lights from spheres, and positions where several placements give them."""
    shapes = {placement.images.shape for placement in placements}
    if len(shapes) != 1:
        raise InputError(
            f"{len(placements)} placements of the sphere with {len(shapes)} sizes or numbers of "
            "lights; give the same for each"
        )
    check_placements_differ([placement.images for placement in placements])
    measured = []
    for number, placement in enumerate(placements, start=1):
        try:
            measured.append(_MeasuredSphere.of(placement, kind, focal_px))
        except CalibrationRejected as error:
            prefix = f"placement {number}: " if len(placements) > 1 else ""
            raise CalibrationRejected(f"{prefix}{error}") from error
    points, directions, errors = (
        np.stack(rays) for rays in zip(*(placement.rays for placement in measured), strict=True)
    )
    mean, mean_error = _mean_directions(directions, errors)
    intensities = np.exp(np.mean([np.log(placement.levels) for placement in measured], axis=0))
    residual = float(np.sqrt(np.mean([placement.residual**2 for placement in measured])))
    positions = positions_of_rays(points, directions, errors) if len(placements) > 1 else None
    if positions is not None:
        light_positions, across, along = positions
        lighting = Lighting(light_positions, intensities, positions_px=light_positions)
        distance_errors: Floats | None = along
    else:
        lighting, across, distance_errors = Lighting(mean, intensities), mean_error, None
    worst = int(np.argmax(across))
    if np.degrees(across[worst]) > _MAX_ERROR_DEG:
        raise CalibrationRejected(
            f"light {worst} is known to {np.degrees(across[worst]):.0f} degrees only; show the "
            "sphere larger, on a background that its outline stands out from, or give a mask"
        )
    lights = CalibratedLights(
        lighting=lighting,
        source="mirror sphere" if kind == "mirror" else "matte sphere",
        direction_errors_deg=np.degrees(across),
        distance_errors=distance_errors,
        residual=residual,
        lobe_exponent=None,
    )
    return SphereLights(
        lights,
        tuple(placement.sphere for placement in measured),
        tuple(placement.outline_score for placement in measured),
        tuple(doubt for placement in measured for doubt in placement.doubts),
    )


@dataclass(frozen=True, eq=False)
class _MeasuredSphere:
    """A sphere at one place, and the lights that it shows."""

    sphere: Sphere
    outline_score: float
    rays: tuple[Floats, Floats, Floats]  # (N, 3) points and directions, (N,) errors in radians
    levels: Floats  # (N,) of a matt sphere; (0,) of a mirror
    residual: float
    doubts: Sequence[str]

    @classmethod
    def of(cls, placement: SphereImages, kind: SphereKind, focal_px: float | None) -> Self:
        """Find the sphere, and measure the lights by it."""
        rows, columns = placement.images.shape[1:]
        if placement.mask is None:
            outline = find_outline(placement.images, is_mirror=kind == "mirror")
        else:
            outline = outline_of_mask(placement.mask)
        sphere = Sphere.of_outline(outline, (rows, columns), focal_px)
        if kind == "mirror":
            directions, errors, points, doubts = mirror_directions(
                placement.images, sphere, placement.ambient
            )
            rays = points, directions, np.radians(errors)
            residual = sphere.error_px / sphere.radius_px
            return cls(sphere, outline.score, rays, np.empty(0), residual, doubts)
        directions, errors, levels, residual = matte_directions(
            _without_ambient(placement), sphere, placement.full_scale, placement.vignetting
        )
        points = np.broadcast_to(sphere.centre, directions.shape)
        rays = points, directions, np.radians(errors)
        return cls(sphere, outline.score, rays, levels, residual, ())


def scale_of_spheres(spheres: Sequence[Sphere], diameter_mm: float) -> Scale:
    """Return the scale at the plane of the part from spheres of known diameter."""
    if not 0.0 < diameter_mm < np.inf:
        raise InputError(f"diameter of {diameter_mm:g} mm; give that of the sphere")
    radii = np.array([sphere.radius_px for sphere in spheres])
    # The error of an outline, and the scatter of the outlines of one sphere.
    error_px = float(np.hypot(max(sphere.error_px for sphere in spheres), radii.std()))
    return Scale(
        mm_per_px=diameter_mm / (2.0 * float(radii.mean())),
        error=error_px / float(radii.mean()),
        camera_matrix=nominal_camera_matrix(spheres[0].frame),
        distortion=None,
        residual_px=float(radii.std()),
    )


def _without_ambient(placement: SphereImages) -> Array:
    """The light images less the ambient one; pixels at full scale stay there."""
    if placement.ambient is None:
        return placement.images
    images, full_scale = placement.images.astype(np.float32), np.float32(placement.full_scale)
    lit = images - placement.ambient.astype(np.float32)
    return np.where(images >= SATURATED * placement.full_scale, full_scale, lit)


def _mean_directions(directions: Floats, errors: Floats) -> tuple[Floats, Floats]:
    """Mean over placements, weighted by errors in radians, and the larger estimate of its error."""
    weights = 1.0 / np.maximum(errors, 1e-6) ** 2
    mean = (weights[..., None] * directions).sum(axis=0)
    mean /= np.linalg.norm(mean, axis=1, keepdims=True)
    error = weights.sum(axis=0) ** -0.5
    if len(directions) > 1:
        squares = ((directions - mean) ** 2).sum(axis=-1)
        scatter = (weights * squares).sum(axis=0) / weights.sum(axis=0)
        scatter /= 2.0 * (len(directions) - 1)
        error = np.maximum(error, np.sqrt(scatter))
    return mean, error


def positions_of_rays(
    points: Floats, directions: Floats, errors: Floats
) -> tuple[Floats, Floats, Floats] | None:
    """(N, 3) positions where (J, N, 3) rays meet, and errors across (rad) and along (a share).

    None if the rays do not determine them.
    """
    # Minimises for each light the sum over rays of |(I - d d^T)(P - X)|^2 / (error |P - X|)^2.
    projections = np.eye(3) - directions[..., :, None] * directions[..., None, :]
    distance = np.ones(errors.shape)
    for _ in range(6):
        weights = 1.0 / (np.maximum(errors, 1e-6) * distance) ** 2
        weighted = weights[..., None, None] * projections
        normal = weighted.sum(axis=0)
        right = np.einsum("jnab,jnb->na", weighted, points)
        if not np.linalg.cond(normal).max() < _MAX_CONDITION:
            return None
        positions = np.linalg.solve(normal, right[..., None])[..., 0]
        covariance = np.linalg.inv(normal)
        distance = np.linalg.norm(positions - points, axis=-1)
    deviations = np.einsum("jnab,jnb->jna", projections, positions - points)
    freedom = deviations.shape[1] * (2 * len(points) - 3)
    excess = max(1.0, float((weights[..., None] * deviations**2).sum()) / freedom)
    length = np.linalg.norm(positions, axis=1)
    towards = positions / length[:, None]
    along = np.einsum("na,nab,nb->n", towards, covariance, towards)
    across = (np.trace(covariance, axis1=1, axis2=2) - along) / 2.0
    along, across = np.sqrt(excess * along) / length, np.sqrt(excess * across) / length
    is_behind = ((positions - points) * directions).sum(axis=-1) <= 0.0
    if is_behind.any() or (towards[:, 2] <= 0.01).any() or along.max() > _MAX_DISTANCE_ERROR:
        return None
    return positions, across, along
