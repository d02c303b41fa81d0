"""Whether faults can be seen: stains and dents by a matched filter, holes by their change."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from classify.surface.estimate import FloatMap
from rig import Placement
from rig.config.simulation import Defect
from rig.scene.material_folder import load_material
from rig.scene.surfaces import Surface, View
from rig.simulation.defective_surface import DefectiveSurface

from .faulty_parts import SIDE_PX, Fault, defect_of, placements

# Share of good parts that may be rejected.
_REJECTED = 0.01
# Least change in a hole, as a share of the texture's root mean square: a hole within a flat tile
# changes 3 to 16 % of the tile's joints, and one across a joint 74 % and more.
_LEAST_REMOVED = 0.25
# Good parts from which a filter learns its texture, and shapes of a fault.
_LEARNED, _SHAPES = 25, 6
# Standard deviation of slopes and relative albedo from noise; shadows would add to it.
_NOISE = 0.01

Fields = npt.NDArray[np.float64]

# In pixels of the fields, which have half the resolution: side; distance from the border within
# which the filter is not used, fade of the fields there, and distance of a fault's response.
_HALF_PX, _MARGIN_PX, _FADE_PX, _NEAR_PX = SIDE_PX // 2, 24, 16, 5
_HANN = np.hanning(_HALF_PX + 2)[1:-1]
_WINDOW = np.outer(_HANN, _HANN) / (_HANN**2).mean()
_EDGE = np.clip((0.5 + np.minimum(np.arange(_HALF_PX), np.arange(_HALF_PX)[::-1])) / _FADE_PX, 0, 1)
_FADE = np.outer(_EDGE, _EDGE)


def holes_seen(material: Path, fault: Fault, count: int, seed: int) -> Iterator[bool]:
    """For each part whether its hole removes texture, of slopes or of albedo."""
    for surface, placement in placements(material, fault, count, seed):
        faulty = DefectiveSurface(surface, placement.defects, {})
        view = View(SIDE_PX, placement.rotate_deg, placement.shift_px)
        hole = faulty.mask(view.size_px, view.rotate_deg, view.shift_px)
        good, bad = (
            _stacked(patch.p, patch.q, patch.albedo)
            for patch in (surface.patch(view), faulty.patch(view))
        )
        change = (bad - good)[:, hole]
        whole = [np.hypot(*good[:2].std(axis=(1, 2))) + _NOISE, good[2].std() + _NOISE]
        removed = [np.sqrt((each**2).sum(axis=0).mean()) for each in (change[:2], change[2:])]
        yield max(np.divide(removed, whole)) >= _LEAST_REMOVED


def seen_by_filter(
    material: Path, fault: Fault, count: int, seed: int, good: int = 100
) -> tuple[float, list[bool]]:
    """D' of a matched filter (North 1943), and for each part whether it finds the fault.

    The filter knows fault, texture and orientation: it sums d^H S^-1 f over frequencies, with the
    spectra d of what the fault changes in slopes and log albedo, f of a part, and the 3 x 3 power
    spectra S of the texture; d'^2 = sum d^H S^-1 d. Its limit is one that 1 % of good parts exceed
    anywhere, because textures that vary have responses far beyond those of a normal distribution.
    """
    draw = np.random.default_rng([1, *material.name.encode()])
    base = load_material(material)
    places = [_drawn_shift(draw) for _ in range(_LEARNED + good)]
    learned = (_noisy_spectra(base, shift, draw, _WINDOW) for shift in places[:_LEARNED])
    power = sum(np.einsum("iyx,jyx->yxij", each, each.conj()) for each in learned) / _LEARNED
    smooth = [np.roll(power, (y, x), (0, 1)) for y in (-1, 0, 1) for x in (-1, 0, 1)]
    shapes = []
    for shift in places[:_SHAPES]:
        faulty = _with_defect(base, defect_of(fault, shift, draw.uniform(0.0, 180.0)))
        shapes.append(np.fft.fft2(_fields(faulty, shift) - _fields(base, shift)))
    shape = np.mean(shapes, axis=0)
    matched = np.einsum("yxij,jyx->iyx", np.linalg.inv(np.mean(smooth, axis=0)), shape)
    d_prime = float(np.sqrt(np.einsum("iyx,iyx->", shape.conj(), matched).real))

    def response(surface: Surface, shift: Sequence[float]) -> Fields:
        spectra = _noisy_spectra(surface, shift, draw, _FADE)
        return np.fft.fftshift(np.fft.ifft2((matched.conj() * spectra).sum(axis=0)).real)

    def is_above(placement: Placement) -> bool:
        (defect,) = placement.defects
        x, y = np.subtract((defect.x_px, defect.y_px), placement.shift_px) / 2.0
        column, row = round(_HALF_PX / 2 + x), round(_HALF_PX / 2 - y)
        responses = response(_with_defect(base, defect), placement.shift_px)
        around = responses[row - _NEAR_PX : row + _NEAR_PX + 1, column - _NEAR_PX :]
        return bool(around[:, : 2 * _NEAR_PX + 1].max() > limit)

    inside = slice(_MARGIN_PX, -_MARGIN_PX)
    highest = [response(base, shift)[inside, inside].max() for shift in places[_LEARNED:]]
    limit = np.quantile(highest, 1.0 - _REJECTED)
    found = [is_above(placement) for _, placement in placements(material, fault, count, seed)]
    return d_prime, found


def _drawn_shift(draw: np.random.Generator) -> tuple[float, ...]:
    return tuple(draw.uniform(-2000.0, 2000.0, 2).tolist())


def _with_defect(surface: Surface, defect: Defect) -> Surface:
    return DefectiveSurface(surface, (defect,), {})


def _noisy_spectra(
    surface: Surface, shift_px: Sequence[float], draw: np.random.Generator, window: Fields
) -> npt.NDArray[np.complex128]:
    fields = _fields(surface, shift_px)
    fields += draw.normal(0.0, 0.5 * _NOISE, fields.shape)
    return np.fft.fft2((fields - fields.mean(axis=(1, 2), keepdims=True)) * window)


def _fields(surface: Surface, shift_px: Sequence[float]) -> Fields:
    """(3, h, w) slopes and log albedo at half resolution."""
    patch = surface.patch(View(SIDE_PX, 0.0, (shift_px[0], shift_px[1])))
    half = (_HALF_PX, _HALF_PX)
    p, q, albedo = (
        np.asarray(cv2.resize(plane, half, interpolation=cv2.INTER_AREA), np.float32)
        for plane in (patch.p, patch.q, patch.albedo)
    )
    return _stacked(p, q, albedo)


def _stacked(p: FloatMap, q: FloatMap, albedo: FloatMap) -> Fields:
    """(3, h, w) slopes and log albedo."""
    return np.stack([p, q, np.log(np.maximum(albedo, 1e-2))]).astype(np.float64)
