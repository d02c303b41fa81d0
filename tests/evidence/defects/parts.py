"""Good and defective parts: places on a texture, captured and solved."""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
import numpy.typing as npt

from capture.chapter.plan import BEST_SOLVER, Conditions, Texture
from capture.chapter.runs import expose, load_surface, solve
from classify import Lighting, SurfaceEstimate
from classify.base.errors import InputError
from rig import Defect
from rig.scene.render import render_frame
from rig.scene.surfaces import PeriodicSurface, View
from rig.simulation.defective_surface import DefectiveSurface
from rig.simulation.simulated_set import SimulatedSet

from .plan import DefectCase

Role = Literal["taught", "tested"]

CONDITIONS = Conditions(slant_deg=45.0, size_px=256)
"""Slant 45, 12 bit, sensor noise and cast shadow, in the smallest frame of a defect map."""

_TILE_PX = 512  # of a synthetic texture
_PARTS_PER_TILE = 4
# Two disjoint frames of any orientation need a material of 724 px; those of 512 px are enlarged.
_MAGNIFICATION = 2
# Share of a material's width from which parts are taught. Tested parts have the rest, in which two
# rotated frames fit above each other: taught parts that are all alike say nothing of others.
_TAUGHT_SHARE = 0.64
# Free border between a defect and the edge of the frame: no detector is asked about half a defect.
_BORDER_PX = 8.0


@dataclass(frozen=True, eq=False)
class Part:
    """A captured part.

    Attributes
    ----------
    images, surface
        The set, and the surface solved from it.
    mask
        (H, W) pixels of the defect.
    angle_deg
        Angle of the defect in the frame.
    """

    images: SimulatedSet
    surface: SurfaceEstimate
    mask: npt.NDArray[np.bool_]
    angle_deg: float = 0.0


def part_of(
    texture: Texture,
    role: Role,
    index: int,
    case: DefectCase | None = None,
    foreign: Texture | None = None,
) -> Part:
    """Capture one part at a random place and orientation, with a defect or without.

    Taught and tested parts of a material come from disjoint pieces of it, those of a synthetic
    texture from different realisations.

    Raises
    ------
    InputError
        If the material is too small for two frames side by side.
    """
    rng = np.random.default_rng(zlib.crc32(f"{texture.name} {role} {index}".encode()))
    # The first taught part defines the orientation 0.
    rotate_deg = 0.0 if (role, index) == ("taught", 0) else float(rng.uniform(0.0, 360.0))
    # A material has one tile.
    seed = 0 if texture.folder else zlib.crc32(role.encode()) + index // _PARTS_PER_TILE
    surface = _surface_of(texture, seed)
    size_px = CONDITIONS.size_px
    shift_px = _place(surface, texture, role, rng)
    mask = np.zeros((size_px, size_px), np.bool_)
    shown: PeriodicSurface | DefectiveSurface = surface
    angle_deg = 0.0
    if case is not None:
        defect = _placed(case, rotate_deg, shift_px, foreign, rng)
        others = {} if foreign is None else {foreign.name: _surface_of(foreign, 0)}
        shown = DefectiveSurface(surface, (defect,), others)
        mask = shown.mask(size_px, rotate_deg, shift_px)
        angle_deg = rotate_deg + defect.angle_deg
    scene = render_frame(shown, Lighting.ring(CONDITIONS.slant_deg), size_px, rotate_deg, shift_px)
    images = expose(scene, CONDITIONS, int(rng.integers(2**31)))
    estimate = solve(images, BEST_SOLVER, planar=True)
    return Part(images, estimate, mask, angle_deg)


@lru_cache(maxsize=2)
def _surface_of(texture: Texture, seed: int) -> PeriodicSurface:
    """One period of a texture, in pixels of the camera."""
    surface = load_surface(texture, seed, _TILE_PX)
    if texture.folder is None:
        return surface
    side_px = _MAGNIFICATION * min(surface.height.shape)
    tile = surface.patch(View(side_px, magnification=float(_MAGNIFICATION)))
    return PeriodicSurface(tile.height, tile.p, tile.q, tile.albedo, surface.name)


def _place(
    surface: PeriodicSurface, texture: Texture, role: Role, rng: np.random.Generator
) -> tuple[float, float]:
    rows, cols = surface.height.shape
    if texture.folder is None:
        right, up = rng.uniform(-0.5, 0.5, 2)
        return float(right * cols), float(up * rows)
    try:
        return place_on_material((rows, cols), role, rng)
    except InputError as error:
        raise InputError(f"{texture.folder}: {error}") from error


def place_on_material(
    shape: tuple[int, int], role: Role, rng: np.random.Generator
) -> tuple[float, float]:
    """Place of a frame, right and up from the middle of a material of `shape` pixels.

    In any orientation the frame is within the piece for its role, on the left of the material or
    on its right, and crosses no edge, because not every material is seamless.

    Raises
    ------
    InputError
        If two frames do not fit beside each other.
    """
    rows, cols = shape
    share, side = (_TAUGHT_SHARE, -1.0) if role == "taught" else (1.0 - _TAUGHT_SHARE, 1.0)
    reach_px = CONDITIONS.size_px / math.sqrt(2.0)
    free = np.array([0.5 * share * cols - reach_px, 0.5 * rows - reach_px])
    if free.min() < 0.0:
        least_px = math.ceil(2.0 * reach_px / ((1.0 - _TAUGHT_SHARE) * _MAGNIFICATION))
        raise InputError(
            f"{cols // _MAGNIFICATION} x {rows // _MAGNIFICATION} px; give materials with a side "
            f"of {least_px} px or more"
        )
    right, up = free * rng.uniform(-1.0, 1.0, 2)
    return float(right + side * 0.5 * (1.0 - share) * cols), float(up)


def _placed(
    case: DefectCase,
    rotate_deg: float,
    shift_px: tuple[float, float],
    foreign: Texture | None,
    rng: np.random.Generator,
) -> Defect:
    """The defect within the frame, at a random angle."""
    reach_px = 0.5 * (CONDITIONS.size_px - case.size_px) - _BORDER_PX
    x, y = rng.uniform(-reach_px, reach_px, 2)
    cos, sin = math.cos(math.radians(rotate_deg)), math.sin(math.radians(rotate_deg))
    place_px = (cos * x + sin * y + shift_px[0], cos * y - sin * x + shift_px[1])
    return case.placed(place_px, rng.uniform(0.0, 360.0), None if foreign is None else foreign.name)
