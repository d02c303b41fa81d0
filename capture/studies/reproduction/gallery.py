"""Sand under four lights: what its figures show (9.5, 9.7 to 9.10)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from classify import Method, SurfaceEstimate, integrate_gradients
from classify.surface.estimate import FloatMap
from classify.texture.fields import TextureFields, texture_fields
from classify.texture.spectra import field_spectra, segment_for
from rig.scene.render import SceneImages

from .plan import SOLVERS
from .scenes import Conditions, Place, Texture, expose, render, solve

__all__ = [
    "GALLERY_SLANT_DEG",
    "GALLERY_TURNS_DEG",
    "POLAR_SOLVERS",
    "TRUTH",
    "GalleryTask",
    "Polar",
    "SandMaps",
    "polar_spectra",
    "sand_maps",
]

GALLERY_SLANT_DEG = 60.0
GALLERY_TURNS_DEG = (0.0, 30.0, 60.0, 90.0, 120.0, 150.0)
POLAR_SOLVERS: tuple[Method, ...] = ("ps3a", "ps3b", "ps3c", "ps3d", *SOLVERS[1:])
TRUTH = "truth"

Polar = dict[str, list[float]]


@dataclass(frozen=True)
class GalleryTask:
    """Sand, turned."""

    turn_deg: float
    size_px: int


@dataclass(frozen=True, eq=False)
class SandMaps:
    """Maps of one patch of sand by solver, and the truth under `TRUTH`.

    Attributes
    ----------
    relief
        (H, W) relative height, px, without its mean.
    albedo
        (H, W) as a fraction; the solvers' on the scale of the truth, by the mean over valid
        pixels that all lights reach.
    errors
        For each solver rms errors of p, q and albedo over the pixels it has a slope for: all, but
        for robust PS4.
    shadows
        (H, W) number of lights in shadow: of the truth, and as the solvers estimate it.
    """

    relief: dict[str, FloatMap]
    albedo: dict[str, FloatMap]
    errors: dict[str, tuple[float, float, float]]
    shadows: dict[str, npt.NDArray[np.uint8]]


def polar_spectra(task: GalleryTask) -> Polar:
    """1D polar spectrum of M at 90 angles over half a turn, for each solver and the truth."""
    scene, estimates = _solved(task, POLAR_SOLVERS)
    segment_px = segment_for(scene.p.shape)
    fields = {solver: texture_fields(surface) for solver, surface in estimates.items()}
    fields[TRUTH] = TextureFields(scene.p, scene.q, scene.albedo)
    return {
        name: [float(value) for value in field_spectra(each, segment_px).polar[0]]
        for name, each in fields.items()
    }


def sand_maps(task: GalleryTask) -> SandMaps:
    """Relief, albedo and shadow of the patch."""
    scene, estimates = _solved(task, SOLVERS)
    shadows = scene.shadowed.sum(axis=0).astype(np.uint8)
    lit = shadows == 0
    albedo = {TRUTH: scene.albedo}
    errors = {}
    for solver, surface in estimates.items():
        common = lit & surface.valid
        scale = scene.albedo[common].mean() / surface.albedo[common].mean()
        albedo[solver] = surface.albedo * scale
        differences = (
            surface.p - scene.p, surface.q - scene.q, albedo[solver] - scene.albedo
        )  # fmt: skip
        p, q, a = (float(np.sqrt(np.square(d[surface.valid]).mean())) for d in differences)
        errors[solver] = (p, q, a)
    relief = {TRUTH: integrate_gradients(scene.p, scene.q)}
    relief |= {solver: integrate_gradients(each.p, each.q) for solver, each in estimates.items()}
    return SandMaps(
        relief,
        albedo,
        errors,
        {TRUTH: shadows} | {solver: each.shadow_count for solver, each in estimates.items()},
    )


def _solved(
    task: GalleryTask, solvers: tuple[Method, ...]
) -> tuple[SceneImages, dict[str, SurfaceEstimate]]:
    place = Place(Texture("sand"), seed=0, elsewhere=False, rotate_deg=task.turn_deg)
    scene = render(place, GALLERY_SLANT_DEG, task.size_px)
    shot = expose(scene, Conditions(GALLERY_SLANT_DEG, task.size_px), round(task.turn_deg))
    return scene, {solver: solve(shot, solver) for solver in solvers}
