"""Whitening: relief and albedo divided by the spectra of their texture.

A filter that divides by the root of the power spectrum turns a stationary texture into white noise
of variance 1. Divided by the power itself, and correlated with the shape of a defect, it shows that
defect with the largest possible signal-to-noise ratio (the matched filter of North 1943).

The power spectrum of two fields is a matrix at each frequency. In many textures low places are
dark, so that the relief predicts the albedo. The predicted albedo is subtracted, which makes stains
stand out. The prediction uses the real part of the cross spectrum, which is the same for a part
that is rotated by 180 degrees: the orientation of many textures is known modulo 180 degrees only.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Self

import cv2
import numpy as np
import numpy.typing as npt
import scipy.fft

from classify.base.compiling import Array, kernel, kernel_part
from classify.base.errors import InputError
from classify.base.threads import map_in_threads, run_on_rows
from classify.surface.estimate import FloatMap

from .fields import PartFields

# Sides of a segment of the spectra, in pixels at half resolution; the first is for frames that hold
# two of them beside each other. A segment as large as the frame gives noisy gains, and a small one
# does not resolve the lines of periodic textures.
_SEGMENTS = (128, 64)
MIN_SIDE_PX = 4 * _SEGMENTS[-1]
"""Shortest side of a good part: two segments at half resolution."""
# Least mean weight of a segment that counts; the others have mostly faded to 0.
_MIN_WEIGHT = 0.5
# Power added to every frequency, as a share of the mean power: errors of focus, scale and
# orientation spread about this share over other frequencies.
_FLOOR = 1e-3
# Frequencies between which the low-pass falls from 1 to 0, in cycles per pixel. The band is
# isotropic, so that a texture is filtered equally at all orientations.
_PASS, _STOP = 0.40, 0.48

_Power = npt.NDArray[np.float64]
HalfSpectrum = npt.NDArray[np.complex64]


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Power spectra of relief (slope along the wave vector) and albedo, and their cross spectrum.

    (n, n) float64 each. Zero frequency is in the middle. The orientation is 0, with y up.
    """

    relief: _Power
    albedo: _Power
    shared: _Power  # real part of their cross spectrum

    @classmethod
    def of(cls, fields: PartFields, orientation_deg: float) -> Self:
        """Mean power of the segments of a part; InputError if too little of it is valid."""
        fits = [side for side in _SEGMENTS if 2 * side <= min(fields.p.shape)]
        segment = fits[0] if fits else _SEGMENTS[-1]
        window = _window(segment)
        u = np.fft.fftfreq(segment)
        v = -u[:, None]
        length = np.maximum(np.hypot(u, v), 1e-9)
        relief, albedo, shared = np.zeros((3, segment, segment))
        count = 0
        for top, left in _segment_corners(fields.p.shape, segment):
            piece = np.s_[top : top + segment, left : left + segment]
            if fields.weight[piece].mean() < _MIN_WEIGHT:
                continue
            p, q, a = (
                scipy.fft.fft2((plane[piece] - plane[piece].mean()) * window)
                for plane in (fields.p, fields.q, fields.albedo)
            )
            raised = -1j * (u * p + v * q) / length
            relief += np.abs(raised) ** 2
            albedo += np.abs(a) ** 2
            shared += (raised.conj() * a).real
            count += 1
        if count == 0:
            raise InputError(
                f"no area of {2 * segment} x {2 * segment} px of a good part has enough valid "
                "pixels; check its light and mask"
            )
        powers = (scipy.fft.fftshift(power / count) for power in (relief, albedo, shared))
        return cls(*(_rotated(power, orientation_deg) for power in powers))

    def gains(self) -> FloatMap:
        """(3, n // 2 + 1, n + 1) float32 gains; the lower half has the same values.

        They are gain of the relief, gain of the albedo beyond what the relief predicts of it, and
        gain of the white relief in that prediction.
        """
        # The window mixes the lowest frequencies with frequency 0: they get the highest power of
        # the ring around them, and no cross spectrum.
        index = np.arange(len(self.relief)) - len(self.relief) // 2
        radius = np.hypot(index[None, :], index[:, None])
        lowest, ring = radius < 1.5, (radius >= 1.5) & (radius < 3.0)
        relief, albedo = (
            np.where(lowest, power[ring].max(), power) for power in (self.relief, self.albedo)
        )
        relief += _FLOOR * relief.mean() + 1e-12
        albedo += _FLOOR * albedo.mean() + 1e-12
        # The root of the inverse of the matrix of the powers (Cholesky).
        predicted = np.where(lowest, 0.0, self.shared) / np.sqrt(relief)
        gain = 1.0 / np.sqrt(albedo - predicted**2)
        gains = np.stack([1.0 / np.sqrt(relief), gain, gain * predicted])
        padded = np.pad(gains, ((0, 0), (0, 0), (0, 1)), mode="wrap")
        return np.asarray(padded[:, : len(index) // 2 + 1], np.float32)


def mean_spectrum(spectra: Sequence[Spectrum]) -> Spectrum:
    """The mean of the spectra of several parts."""
    return Spectrum(*np.mean([[*vars(spectrum).values()] for spectrum in spectra], axis=0))


def white_spectra(
    fields: PartFields, gains: FloatMap, orientation_deg: float
) -> tuple[tuple[HalfSpectrum, HalfSpectrum], tuple[HalfSpectrum, HalfSpectrum]]:
    """Half spectra of relief and albedo of a part at `orientation_deg`, in two versions.

    They are divided by the root of the matrix of their powers, and by the matrix. Raised and bright
    places are positive.
    """
    shape = fields.p.shape
    p, q, a = map_in_threads(scipy.fft.rfft2, [fields.p, fields.q, fields.albedo])
    angle = np.radians(orientation_deg)
    rotation = np.array([np.cos(angle), np.sin(angle)], np.float32)
    relief, albedo = np.empty_like(p), np.empty_like(p)
    band = _band(shape, gains.shape[2] - 1)
    run_on_rows(partial(_apply_gains, p, q, a, gains, band, rotation, relief, albedo), p.shape)
    return (relief, albedo), (p, a)


@lru_cache(maxsize=2)
def _window(segment: int) -> FloatMap:
    """Hann window whose squares sum to 1."""
    line = 0.5 - 0.5 * np.cos(2.0 * np.pi * (np.arange(segment) + 0.5) / segment)
    window = np.outer(line, line)
    return np.asarray(window / np.sqrt(np.sum(window**2)), np.float32)


def _segment_corners(shape: tuple[int, ...], segment: int) -> list[tuple[int, int]]:
    """Corners of segments that overlap by about a half and cover the frame."""
    lines = []
    for side in shape:
        count = 1 + -(-2 * (side - segment) // segment)
        lines.append(np.linspace(0, side - segment, max(count, 1)).round().astype(int).tolist())
    return [(top, left) for top in lines[0] for left in lines[1]]


@lru_cache(maxsize=4)
def _band(shape: tuple[int, int], segment: int) -> FloatMap:
    """Band-pass on a half spectrum: the frequencies that are whitened."""
    radius = np.hypot(*frequencies(shape))
    # Longer waves than a segment are drift of lights and form, which the spectra do not resolve.
    return np.asarray(low_pass(radius) * -np.expm1(-((radius * segment) ** 2)), np.float32)


def low_pass(radius: _Power) -> _Power:
    """Isotropic low-pass at a distance from zero frequency, in cycles per pixel."""
    return 0.5 + 0.5 * np.cos(np.pi * np.clip((radius - _PASS) / (_STOP - _PASS), 0.0, 1.0))


def frequencies(shape: tuple[int, int]) -> tuple[_Power, _Power]:
    """U to the right, (1, columns // 2 + 1), and v up, (rows, 1), of a half spectrum."""
    rows, columns = shape
    u, v = np.fft.rfftfreq(columns), -np.fft.fftfreq(rows)
    return u[None, :].astype(np.float64), v[:, None].astype(np.float64)


@kernel
def _apply_gains(
    p: Array,
    q: Array,
    a: Array,
    gains: Array,
    band: Array,
    rotation: Array,
    relief: Array,
    albedo: Array,
    first: int,
    stop: int,
) -> None:
    """Whiten half spectra into `relief` and `albedo`, and once more into `p` and `a`."""
    rows, half = p.shape
    u_step, v_step = np.float32(0.5 / (half - 1)), np.float32(1.0 / rows)
    side = np.float32(gains.shape[2] - 1)
    middle, zero, one = np.float32(0.5), np.float32(0.0), np.float32(1.0)
    c, s = rotation[0], rotation[1]
    for r in range(first, stop):
        v = -v_step * np.float32(r if 2 * r < rows else r - rows)
        for k in range(half):
            u = u_step * np.float32(k)
            # v is up, and rows of the gains run down; only their upper half is stored.
            x, y = c * u + s * v, c * v - s * u
            if y < zero:
                x, y = -x, -y
            x = min(max((middle + x) * side, zero), side - one)
            y = max((middle - y) * side, zero)
            column, row = int(x), min(int(y), gains.shape[1] - 2)
            x -= np.float32(column)
            y -= np.float32(row)
            relief_gain = _bilinear(gains[0], row, column, x, y)
            albedo_gain = _bilinear(gains[1], row, column, x, y)
            predicted_gain = _bilinear(gains[2], row, column, x, y)
            scale = band[r, k] * relief_gain / np.sqrt(max(u * u + v * v, np.float32(1e-18)))
            u_scaled, v_scaled = scale * u, scale * v
            # -i times the slope along the wave vector is positive on raised places.
            real = u_scaled * p[r, k].real + v_scaled * q[r, k].real
            imaginary = u_scaled * p[r, k].imag + v_scaled * q[r, k].imag
            relief[r, k] = complex(imaginary, -real)
            albedo[r, k] = band[r, k] * albedo_gain * a[r, k] - predicted_gain * relief[r, k]
            p[r, k] = relief_gain * (relief[r, k] - predicted_gain * albedo[r, k])
            a[r, k] = albedo_gain * albedo[r, k]


@kernel_part
def _bilinear(gains: Array, row: int, column: int, x: np.float32, y: np.float32) -> np.float32:
    one = np.float32(1.0)
    upper = (one - x) * gains[row, column] + x * gains[row, column + 1]
    lower = (one - x) * gains[row + 1, column] + x * gains[row + 1, column + 1]
    return np.float32((one - y) * upper + y * lower)


def _rotated(power: _Power, orientation_deg: float) -> _Power:
    """The spectrum in the frame of a texture at `orientation_deg` in the image."""
    angle = np.radians(orientation_deg)
    c, s = np.cos(angle), np.sin(angle)
    side = len(power)
    u = (np.arange(side) - side // 2)[None, :] / side
    v = -u.T
    x = (c * u - s * v + 0.5) * side
    y = (0.5 - s * u - c * v) * side
    padded = np.pad(power, ((0, 1), (0, 1)), mode="wrap").astype(np.float32)
    rotated = cv2.remap(
        padded, x.astype(np.float32), y.astype(np.float32), cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )  # fmt: skip
    return rotated.astype(np.float64)
