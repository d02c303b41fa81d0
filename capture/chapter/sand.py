"""Shadow counts of the four surfaces, and spectra and maps of sand: figures 9.2 to 9.10."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from classify import Lighting, Method, SurfaceEstimate, integrate_gradients
from classify.surface.estimate import FloatMap
from classify.texture.fields import TextureFields, texture_fields
from classify.texture.spectra import field_spectra, segment_for
from rig.scene.render import SceneImages, render_frame

from .patches import expose, load_surface, render_patch, solve
from .plan import SOLVERS, Conditions, PatchPosition, Texture

SAND_SLANT_DEG = 60.0
"""Each light leaves a fifth of sand in shadow; the thesis does not state its slant."""

SHADOW_TILTS_DEG = (0.0, 30.0, 60.0, 90.0)
_SHADOW_PX = 512
_POLAR_SOLVERS: tuple[Method, ...] = ("ps3a", "ps3b", "ps3c", "ps3d", *SOLVERS[1:])
TRUTH = "truth"

Polar = dict[str, list[float]]


def shadow_shares(texture_and_slant: tuple[str, float]) -> tuple[float, ...]:
    """Share of the pixels of a synthetic texture in shadow of a light, for each tilt."""
    name, slant_deg = texture_and_slant
    surface = load_surface(Texture(name), 0, _SHADOW_PX)
    scene = render_frame(surface, Lighting.ring(slant_deg, SHADOW_TILTS_DEG), _SHADOW_PX)
    shares: list[float] = scene.shadowed.mean(axis=(1, 2)).tolist()
    return tuple(shares)


@dataclass(frozen=True, eq=False)
class SandMaps:
    """(H, W) maps of one patch of sand by solver, and the true ones under `TRUTH`.

    Albedo is scaled to the mean of the truth over valid pixels that all lights reach. The errors
    are rms errors of p, q and albedo over the valid pixels: all pixels, except for robust PS4.
    """

    relief: dict[str, FloatMap]  # height in px, of mean 0
    albedo: dict[str, FloatMap]
    errors: dict[str, tuple[float, float, float]]
    shadows: dict[str, npt.NDArray[np.uint8]]  # number of lights in shadow


def polar_spectra(rotate_deg: float, size_px: int) -> Polar:
    """1D polar spectrum of M at 90 angles over 180 degrees, by solver and of the truth."""
    scene, surfaces = _solved(rotate_deg, size_px, _POLAR_SOLVERS)
    fields = {solver: texture_fields(surface) for solver, surface in surfaces.items()}
    fields[TRUTH] = TextureFields(scene.p, scene.q, scene.albedo)
    segment_px = segment_for(scene.p.shape)
    return {
        name: [float(value) for value in field_spectra(fields[name], segment_px).polar[0]]
        for name in fields
    }


def sand_maps(size_px: int) -> SandMaps:
    """Relief, albedo and shadow of the patch."""
    scene, surfaces = _solved(0.0, size_px, SOLVERS)
    shadows = scene.shadowed.sum(axis=0).astype(np.uint8)
    relief = {TRUTH: integrate_gradients(scene.p, scene.q)}
    albedo = {TRUTH: scene.albedo}
    errors = {}
    for solver, surface in surfaces.items():
        lit = (shadows == 0) & surface.valid
        scale = scene.albedo[lit].mean() / surface.albedo[lit].mean()
        albedo[solver] = surface.albedo * scale
        relief[solver] = integrate_gradients(surface.p, surface.q)
        estimates = (surface.p, surface.q, albedo[solver])
        p, q, a = (
            float(np.sqrt(np.square(estimate - truth)[surface.valid].mean()))
            for estimate, truth in zip(estimates, (scene.p, scene.q, scene.albedo), strict=True)
        )
        errors[solver] = (p, q, a)
    counts = {solver: surface.shadow_count for solver, surface in surfaces.items()}
    return SandMaps(relief, albedo, errors, {TRUTH: shadows} | counts)


def _solved(
    rotate_deg: float, size_px: int, solvers: tuple[Method, ...]
) -> tuple[SceneImages, dict[str, SurfaceEstimate]]:
    position = PatchPosition(Texture("sand"), 0, (0.0, 0.0), rotate_deg)
    scene = render_patch(position, SAND_SLANT_DEG, size_px)
    images = expose(scene, Conditions(SAND_SLANT_DEG, size_px), round(rotate_deg))
    return scene, {solver: solve(images, solver) for solver in solvers}
