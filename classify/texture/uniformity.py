"""Uniformity: whether one set shows its class, because its pieces look alike.

An energy is the square of a response, averaged over a window of an eighth of the frame's sides. A
piece has two by two windows. The log energies of a texture differ between pieces by as much as the
scatter of the windows within pieces explains, whatever the contrast; those of a picture, an edge or
one feature differ by more. Noise adds equally to all energies: it hides differences, but makes
none.
"""

from collections.abc import Mapping, Sequence
from typing import Literal

import cv2
import numpy as np

from classify.base.arrays import Array, FloatMap

from .fields import TextureFields

Uniformity = Literal["uniform", "varied", "no texture"]

_REMARKS: dict[Uniformity, str] = {
    "varied": "differs from place to place; teach several places",
    "no texture": "is no texture: a picture, an edge or one feature",
}

# Bounds of the unevenness; see "Uniformity" in classify/DECISIONS.md.
_MAX_UNIFORM_UNEVENNESS = 0.3
_NO_TEXTURE = 0.63
# Floors of the energies: curvatures of 0.01 per pixel, changes of albedo by 3 % of its mean.
_FLOORS = (1e-4, 1e-3)
_OCTAVES = 3
_PIECES = 4  # along each side of the frame
_WINDOWS = 2  # along each side of a piece
# A smaller frame holds fewer of the largest features of a texture. The variance that their number
# explains is inversely proportional to it, so the excess is reduced in proportion to the pixels.
_SUFFICIENT_PIXELS = 256 * 256


def unevenness(fields: TextureFields) -> float:
    """Standard deviation of the log energy of the median piece beyond that of windows."""
    # A variance component of one-way analysis (Searle, Casella and McCulloch 1992).
    logs = _log_energies(fields).reshape(-1, _PIECES, _WINDOWS, _PIECES, _WINDOWS)
    within = np.median(logs.var(axis=(2, 4)), axis=(1, 2)) / (_WINDOWS**2 - 1)
    between = logs.mean(axis=(2, 4)).var(axis=(1, 2)) * _PIECES**2 / (_PIECES**2 - 1)
    unexplained_share = min(fields.p.size / _SUFFICIENT_PIXELS, 1.0)
    return float(np.sqrt(max((between - within).mean(), 0.0) * unexplained_share))


def uniformity_of(unevennesses: Sequence[float]) -> Uniformity:
    """The uniformity of a class, from the unevenness of each of its sets."""
    typical = float(np.sqrt(np.mean(np.square(unevennesses))))
    if typical > _NO_TEXTURE:
        return "no texture"
    return "varied" if typical > _MAX_UNIFORM_UNEVENNESS else "uniform"


def uniformity_remarks(uniformity: Mapping[str, Uniformity]) -> list[str]:
    """A remark on each class that is not uniform."""
    return [f"{label} {_REMARKS[kind]}" for label, kind in uniformity.items() if kind in _REMARKS]


def _log_energies(fields: TextureFields) -> FloatMap:
    """(2 x octaves, 8, 8) log mean squares of the curvature of relief and of albedo."""
    planes: list[Array] = [fields.p, fields.q, fields.albedo]
    side = _PIECES * _WINDOWS
    logs = []
    for octave in range(_OCTAVES):
        if octave:
            planes = [cv2.pyrDown(plane) for plane in planes]
        p, q, albedo = planes
        # The image's rows run down, y runs up.
        relief = cv2.Sobel(p, -1, 1, 0, scale=0.125) - cv2.Sobel(q, -1, 0, 1, scale=0.125)
        for response, floor in zip((relief, cv2.Laplacian(albedo, -1)), _FLOORS, strict=True):
            energies = cv2.resize(response * response, (side, side), interpolation=cv2.INTER_AREA)
            logs.append(np.log(energies + np.float32(floor)))
    return np.stack(logs)
