"""The circular shift between polar spectra, which is the orientation of a surface."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.fft

from classify.base.arrays import Floats

from .spectra import ANGLES

STEP_DEG = 180.0 / ANGLES


def squared_errors_by_shift(
    test: npt.NDArray[np.floating], references: npt.NDArray[np.floating]
) -> Floats:
    """(n, A) sums over theta of (test(theta + phi) - reference(theta))^2 by phi.

    By circular cross-correlation along the last axis by FFT (thesis section 6.4.6); entry j is for
    a reference shifted anticlockwise by j steps of the grid.
    """
    between = tuple(range(1, references.ndim - 1))
    cross = scipy.fft.rfft(test.astype(np.float64)) * np.conj(
        scipy.fft.rfft(references.astype(np.float64))
    )
    correlation = scipy.fft.irfft(cross.sum(axis=between), n=test.shape[-1])
    energy = np.sum(np.square(test, dtype=np.float64)) + np.sum(
        np.square(references, dtype=np.float64), axis=(*between, references.ndim - 1)
    )
    errors: Floats = energy[:, None] - 2.0 * correlation
    return errors


def best_shift(errors: Floats) -> Floats:
    """(n,) shift in grid steps at the lowest of (n, A) errors, refined by a parabola."""
    shifts, _ = refined_minima(errors, 1e-12 * np.abs(errors.min(axis=-1)))
    return np.mod(shifts, errors.shape[-1])


def refined_minima(errors: Floats, flat_below: Floats) -> tuple[Floats, Floats]:
    """(n,) positions and values of the minima of (n, A) periodic errors, by a parabola."""
    count = errors.shape[-1]
    lowest = np.argmin(errors, axis=-1)
    row = np.arange(len(errors))
    before, least, after = (errors[row, (lowest + step) % count] for step in (-1, 0, 1))
    curvature = before - 2.0 * least + after
    flat = curvature <= flat_below + 1e-30
    offset = np.where(flat, 0.0, 0.5 * (before - after) / np.where(flat, 1.0, curvature))
    return lowest + offset, least - 0.25 * (before - after) * offset


def roll_angles(polar: npt.NDArray[np.floating], shifts: Floats) -> Floats:
    """(n, ..., A) `polar` (..., A) shifted back by (n,) `shifts`, by a Fourier phase ramp."""
    transform = scipy.fft.rfft(polar.astype(np.float64))
    order = np.arange(transform.shape[-1])
    count = polar.shape[-1]
    ramp = np.exp(2j * np.pi * order * shifts[:, None] / count)
    ramp = ramp.reshape(len(shifts), *(1,) * (polar.ndim - 1), -1)
    shifted: Floats = scipy.fft.irfft(transform * ramp, n=count)
    return shifted


# Agreement below which a texture determines no orientation; its rates on 52 textures are in
# tests/capture/session/test_orientation_flags.py.
LEAST_SHARPNESS = 0.45


@dataclass(frozen=True, eq=False)
class OrientationProfile:
    """Agreement of a surface with a reference, by orientation."""

    agreement: Floats  # (180,) at 0 to 179 degrees; 1 equal, 0 unrelated

    def best(self, near_deg: float = 0.0, within_deg: float = 90.0) -> tuple[float, float]:
        """Return the best orientation near `near_deg`, in [0, 180), and its agreement."""
        distance_deg = np.abs((np.arange(180) - near_deg + 90.0) % 180.0 - 90.0)
        allowed = np.where(distance_deg <= within_deg, self.agreement, -np.inf)
        index = int(np.argmax(allowed))
        # A parabola through a peak; the end of a slope is not refined.
        around = self.agreement[[index - 1, index, (index + 1) % 180]]
        if around.argmax() != 1:
            return float(index), float(around[1])
        offset, least = refined_minima(-around[None, :], np.zeros(1))
        return float((index - 1 + offset[0]) % 180.0), float(-least[0])
