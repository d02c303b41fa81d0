"""The four synthetic surfaces of the thesis: rock, sand, malv, ogil (SCIENCE section 3)."""

from __future__ import annotations

import zlib
from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from scipy import fft

from classify.errors import InputError

from .surfaces import MAX_SIDE_PX, PeriodicSurface, rms_slope, round_band_limit, spectral_gradients

__all__ = ["ALBEDO", "RMS_SLOPE", "SYNTHETIC_NAMES", "synthetic_surface", "tile_side_px"]

Frequencies = npt.NDArray[np.float64]

RMS_SLOPE = 0.5
"""sqrt(mean(p^2 + q^2)) of every tile: of 0.4 to 0.5 what gives sand its shadow counts."""

ALBEDO = 0.8
"""Everywhere: the thesis's synthetic surfaces differ in relief alone."""

SMALLEST_TILE_PX, LARGEST_TILE_PX = 512, 4096


def _rock(u: Frequencies, v: Frequencies) -> Frequencies:
    """Isotropic fractal, w^-3 (beta = 2H + 2)."""
    return np.asarray(np.hypot(u, v) ** -3.0)


def _malv(u: Frequencies, v: Frequencies) -> Frequencies:
    """After Mulvaney (1989): flat up to 0.04 cycles/px, then as rock."""
    return np.asarray(((u**2 + v**2) / 0.04**2 + 1.0) ** -1.5)


def _ogil(u: Frequencies, v: Frequencies) -> Frequencies:
    """After Ogilvy: a grain along x, as it is smoother along x than along y."""
    return 1.0 / ((u**2 + 0.03**2) * (v**2 + 0.12**2))


def _sand(u: Frequencies, v: Frequencies) -> Frequencies:
    """Ripples of 20 pixels whose wave vector lies along x: Gaussian lobes at +-0.05 cycles/px."""
    across = np.exp(-0.5 * (v / 0.012) ** 2)
    lobes = np.exp(-0.5 * ((u - 0.05) / 0.010) ** 2) + np.exp(-0.5 * ((u + 0.05) / 0.010) ** 2)
    return np.asarray(across * lobes)


_POWER_SPECTRA: dict[str, Callable[[Frequencies, Frequencies], Frequencies]] = {
    "rock": _rock,
    "sand": _sand,
    "malv": _malv,
    "ogil": _ogil,
}

SYNTHETIC_NAMES = tuple(_POWER_SPECTRA)


def tile_side_px(size_px: int) -> int:
    """The side of the tile to take for a frame of side `size_px`.

    A power of two of at least twice the frame, so that no part of a turned frame is seen twice,
    within 512 and 4096: the spline of a larger tile would need more than a gigabyte, and a frame
    beyond 2048 pixels sees parts of the surface again.
    """
    wanted = 1 << max(2 * size_px - 1, 1).bit_length()
    return min(max(wanted, SMALLEST_TILE_PX), LARGEST_TILE_PX)


def synthetic_surface(name: str, seed: int, tile_px: int) -> PeriodicSurface:
    """A Gaussian random surface with the power spectrum of one of `SYNTHETIC_NAMES`.

    Random phases and Rayleigh amplitudes, in cycles per pixel whatever the size of the tile;
    level on average, of rms slope `RMS_SLOPE` and of one albedo, `ALBEDO`.

    Parameters
    ----------
    name
        rock, sand, malv or ogil.
    seed
        Not negative. The same seed and side give the same surface, another seed another
        realisation of the same texture.
    tile_px
        Side of the tile, 16 to `MAX_SIDE_PX`; see `tile_side_px`.

    Raises
    ------
    InputError
        For a name that is not known, a negative seed or a side out of range.
    """
    if name not in _POWER_SPECTRA:
        raise InputError(
            f"no synthetic surface is called {name!r}; there are {', '.join(SYNTHETIC_NAMES)}"
        )
    if seed < 0:
        raise InputError(f"seed {seed} of surface {name} is negative; give 0 or more")
    if not 16 <= tile_px <= MAX_SIDE_PX:
        raise InputError(f"a tile of {tile_px} px; its side must be 16 to {MAX_SIDE_PX}")
    u = fft.rfftfreq(tile_px)[None, :]
    v = fft.fftfreq(tile_px)[:, None]
    with np.errstate(divide="ignore"):
        amplitude = np.sqrt(_POWER_SPECTRA[name](u, v)) * round_band_limit(tile_px, tile_px)
    amplitude[0, 0] = 0.0
    # The name is part of the seed: two textures of one seed do not share their phases.
    generator = np.random.default_rng([seed, zlib.crc32(name.encode())])
    # White Gaussian noise has Rayleigh amplitudes and free phases, with the right symmetry.
    noise = fft.rfft2(generator.standard_normal((tile_px, tile_px)), workers=-1)
    height = fft.irfft2(noise * amplitude, s=(tile_px, tile_px), workers=-1).astype(np.float32)
    height *= np.float32(RMS_SLOPE / rms_slope(*spectral_gradients(height)))
    return PeriodicSurface.from_height(height, np.full_like(height, ALBEDO), name)
