"""Whether faults can be seen: stains and dents by a linear detector, holes by their change."""

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
from scipy.special import ndtri

from classify.surface.estimate import FloatMap
from rig.config.simulation import Defect
from rig.scene.material_folder import load_material
from rig.scene.surfaces import Surface, View
from rig.simulation.defective_surface import DefectiveSurface

from .faulty_parts import SIDE_PX, Fault, defect_of, placements

# Share of good parts that may be rejected, and of faulty ones that may pass.
_REJECTED, _PASSED = 0.01, 0.01
# Least change in a hole, as a share of the texture's root mean square: a hole within a flat tile
# changes 3 to 16 % of the tile's joints, and one across a joint 74 % and more.
_LEAST_REMOVED = 0.25
_GOOD, _PLACES = 25, 3
# Standard deviation of slopes and relative albedo from noise; shadows would add to it.
_NOISE = 0.01

Fields = npt.NDArray[np.float64]


def least_seen(fault: Fault) -> float:
    """D' at which a linear detector finds 99 % of the faults, wherever they are in a part.

    Its limit is one that 1 % of good parts exceed in any of the places in which a fault of this
    size fits beside others.
    """
    places = (SIDE_PX / fault.strength) ** 2
    return float(-ndtri(_REJECTED / places) - ndtri(_PASSED))


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


def detectability(material: Path, fault: Fault) -> float:
    """Signal-to-noise ratio d' of a matched filter (North 1943) that knows fault and texture.

    d'^2 is the sum of d^H S^-1 d over frequencies, with the spectra d of what the fault changes in
    slopes and log albedo, and the 3 x 3 power spectra S of the texture.
    """
    draw = np.random.default_rng([1, *material.name.encode()])
    base = load_material(material)
    window = np.outer(*[np.hanning(SIDE_PX // 2 + 2)[1:-1]] * 2)
    window /= np.sqrt((window**2).mean())
    power: Fields | npt.NDArray[np.complex128] = np.zeros((1, 1, 3, 3))
    for _ in range(_GOOD):
        fields = _fields(base, tuple(draw.uniform(-2000.0, 2000.0, 2).tolist()))
        fields += draw.normal(0.0, 0.5 * _NOISE, fields.shape)
        fields -= fields.mean(axis=(1, 2), keepdims=True)
        spectra = np.fft.fft2(fields * window)
        power = power + np.einsum("iyx,jyx->yxij", spectra, spectra.conj()) / _GOOD
    smooth = [np.roll(power, (y, x), (0, 1)) for y in (-1, 0, 1) for x in (-1, 0, 1)]
    inverse = np.linalg.inv(sum(smooth) / len(smooth))
    found = []
    for _ in range(_PLACES):
        shift = tuple(draw.uniform(-2000.0, 2000.0, 2).tolist())
        defect: Defect = defect_of(fault, shift, draw.uniform(0.0, 180.0))
        change = _fields(DefectiveSurface(base, (defect,), {}), shift) - _fields(base, shift)
        spectra = np.fft.fft2(change)
        found.append(np.einsum("iyx,yxij,jyx->", spectra.conj(), inverse, spectra).real)
    return float(np.sqrt(np.median(found)))


def _fields(surface: Surface, shift_px: tuple[float, ...]) -> Fields:
    """(3, h, w) slopes and log albedo at half resolution."""
    patch = surface.patch(View(SIDE_PX, 0.0, (shift_px[0], shift_px[1])))
    half = (SIDE_PX // 2, SIDE_PX // 2)
    p, q, albedo = (
        np.asarray(cv2.resize(plane, half, interpolation=cv2.INTER_AREA), np.float32)
        for plane in (patch.p, patch.q, patch.albedo)
    )
    return _stacked(p, q, albedo)


def _stacked(p: FloatMap, q: FloatMap, albedo: FloatMap) -> Fields:
    """(3, h, w) slopes and log albedo."""
    return np.stack([p, q, np.log(np.maximum(albedo, 1e-2))]).astype(np.float64)
