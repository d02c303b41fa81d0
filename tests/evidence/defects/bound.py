"""The bound on linear detectors: a matched filter that knows shape, sign and angle of a defect.

Over texture of power S, the best linear statistic for a known defect d is the sum of d*(k) f(k) /
S(k). Its signal-to-noise ratio d' is the root of the sum of |d(k)|^2 / S(k) (North 1943). For
relief and albedo together, d and f are vectors and S is a matrix.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import scipy.fft

from classify import SurfaceEstimate
from classify.defects.detectability import KnownDefect, Place, Stamp, with_stamps
from classify.defects.fields import PartFields, part_fields
from classify.defects.whitening import Spectrum, mean_spectrum, white_spectra
from classify.surface.estimate import FloatMap

from .parts import Part
from .plan import DefectCase

Fields = tuple[PartFields, float]
"""Fields of a part, and the orientation of its texture in degrees."""

# Width of the scratches of the simulated rig.
_WIDTH_PX = 3.0


class Bound(NamedTuple):
    """Of one defective part: d', and whether the filter finds it above all good parts."""

    d_prime: float
    is_found: bool


class MatchedFilters:
    """Filters for known defects on one texture, from its taught parts."""

    def __init__(self, taught: Sequence[Fields], good: Sequence[Fields]) -> None:
        self._gains = mean_spectrum([Spectrum.of(*each) for each in taught]).gains()
        self._good = [(self._white(*each), each[1]) for each in good]

    def bound(self, case: DefectCase, part: Part, orientation_deg: float) -> Bound:
        """The bound for a defective part; the filter rotates with the texture."""
        white = self._white(part_fields(part.surface), orientation_deg)
        angle_deg = part.angle_deg - orientation_deg
        d_prime, found = self._response(case, white, angle_deg, orientation_deg)
        highest = max(
            self._response(case, each, angle_deg, orientation)[1]
            for each, orientation in self._good
        )
        return Bound(d_prime, found > highest)

    def _white(self, fields: PartFields, orientation_deg: float) -> npt.NDArray[np.complex64]:
        """Half spectra of relief and albedo, divided by the root of their powers."""
        return np.array(white_spectra(fields, self._gains, orientation_deg)[0])

    def _response(
        self,
        case: DefectCase,
        white: npt.NDArray[np.complex64],
        angle_deg: float,
        orientation_deg: float,
    ) -> tuple[float, float]:
        """Return d' of a defect, and the highest response of its filter, in standard deviations."""
        fields = part_fields(_defect(case, angle_deg + orientation_deg, 2 * white.shape[1]))
        shape = self._white(fields, orientation_deg)
        sides = (white.shape[1], 2 * (white.shape[2] - 1))
        d_prime = math.sqrt(float(np.sum(_inverse(shape, sides) ** 2)))
        response = _inverse((white * shape.conj()).sum(axis=0), sides) / max(d_prime, 1e-9)
        return d_prime, float(response.max())


def _inverse(spectrum: npt.NDArray[np.complex64], sides: tuple[int, int]) -> FloatMap:
    return np.asarray(scipy.fft.irfft2(spectrum, s=sides), np.float32)


def _defect(case: DefectCase, angle_deg: float, side_px: int) -> SurfaceEstimate:
    """A flat white part with the defect in its middle."""
    flat, white = np.zeros((side_px, side_px), np.float32), np.ones((side_px, side_px), np.float32)
    part = SurfaceEstimate(flat, flat, white, white > 0.0, "")
    known = (
        KnownDefect("scratch", _WIDTH_PX, case.size_px)
        if case.kind == "scratch"
        else KnownDefect("stain" if case.kind == "stain" else "dent", case.size_px)
    )
    middle = 0.5 * (side_px - 1)
    stamp = Stamp.of(part.shape, known, Place(middle, middle, math.radians(angle_deg)))
    strength = case.strength or 0.0
    return with_stamps(part, [stamp], np.array([-strength if case.kind == "bump" else strength]))
