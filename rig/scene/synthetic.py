"""Synthetic textures: the four of the thesis, 26 more, 2 twins of equal spectrum.

`SYNTHETIC_30` holds the four of J. Wu (PhD thesis, Heriot-Watt University, 2003), variations of
them, and relief that is not Gaussian. Any two differ in the power spectrum of relief or albedo,
some only a little, and four pairs in albedo alone. Each of `EQUAL_SPECTRUM_TWINS` has the power
spectra of one of the 30.

The parameters of the four are: rock w^-3; malv (Mulvaney 1989) with cut-off 0.04 cycles/px; ogil
(Ogilvy) with cut-offs 0.03 and 0.12; sand with Gaussian lobes at +-0.05 of widths 0.010 and 0.012,
because Linnett's formula for sand was not found. At `_RMS_SLOPE` this sand has the shadow counts of
the thesis: 1, 7, 19, 37 and 61 % at slants 40 to 80 (tests/rig/scene/test_render.py). The
parameters of the others were chosen for variety; test_synthetic.py there tests that they differ.
"""

import zlib
from dataclasses import dataclass

import numpy as np

from classify.base.arrays import Floats
from classify.base.errors import InputError

from .random_fields import (
    Field,
    cells,
    crested,
    fractal,
    gaussian,
    inverted,
    mulvaney,
    ogilvy,
    phase_randomised,
    ridged,
    ring,
    ripples,
    rotated,
    shaded,
    shot_noise,
    summed,
)
from .surfaces import MAX_SIDE_PX, PeriodicSurface, rms_slope, spectral_gradients

_RMS_SLOPE = 0.5  # sqrt(mean(p^2 + q^2)) of the four; gives sand its shadow counts
ALBEDO = 0.8  # without a pattern; the synthetic surfaces of the thesis differ in relief alone

# Mean and half-range of a pattern's albedo, within the 0.05 to 1 of real reflectances.
_PATTERN_ALBEDO, _PATTERN_SWING, _DARKEST = 0.55, 0.3, 0.05

_MIN_TILE_PX, _MAX_TILE_PX = 512, 4096


@dataclass(frozen=True)
class _Pattern:
    """Albedo of mean `_PATTERN_ALBEDO` and range +-`_PATTERN_SWING`, from a field or the height."""

    field: Field | None
    contrast: float

    def albedo(self, height: Floats, rng: np.random.Generator) -> Floats:
        values = height if self.field is None else self.field(rng, len(height))
        # A few pixels in a million overshoot the range of reflectances (see `shaded`).
        pattern = _PATTERN_ALBEDO + _PATTERN_SWING * shaded(values, self.contrast)
        return np.clip(pattern, _DARKEST, 1.0)


@dataclass(frozen=True)
class _Texture:
    relief: Field
    rms_slope: float = _RMS_SLOPE
    pattern: _Pattern | None = None


_ROCK = gaussian(fractal(3.0))
_SAND = gaussian(ripples(0.05, 0.010, 0.012))
_MALV = gaussian(mulvaney(0.04))
_FINE_RIPPLES = gaussian(ripples(0.11, 0.018, 0.022))
_DOMES = shot_noise(lambda u, v: np.exp(-((u**2 + v**2) / 0.04**2)), spacing_px=16.0)
_COBBLES = cells(spacing_px=20.0)
_BLOTCHES = gaussian(mulvaney(0.02))
_SPECKLE = gaussian(ring(0.25, 0.06))
_EVEN_RIPPLES = ripples(0.08, 0.010, 0.010)

_THESIS_TEXTURES = {
    "rock": _Texture(_ROCK),
    "sand": _Texture(_SAND),
    "malv": _Texture(_MALV),
    "ogil": _Texture(gaussian(ogilvy(0.03, 0.12))),
}

_VARIATIONS = {
    # Gaussian relief; rock_smooth, malv_near and ripples_near are hard to tell from the four.
    "rock_smooth": _Texture(gaussian(fractal(3.5))),
    "rock_rough": _Texture(gaussian(fractal(2.2)), 0.45),
    "malv_near": _Texture(gaussian(mulvaney(0.07))),
    "malv_fine": _Texture(gaussian(mulvaney(0.15)), 0.45),
    "ogil_long": _Texture(gaussian(ogilvy(0.008, 0.07))),
    "brushed": _Texture(gaussian(ogilvy(0.008, 0.25))),
    "ripples_near": _Texture(gaussian(ripples(0.065, 0.010, 0.012))),
    "ripples_wavy": _Texture(gaussian(ripples(0.05, 0.018, 0.028)), 0.45),
    "ripples_fine": _Texture(_FINE_RIPPLES, 0.45),
    "weave": _Texture(gaussian(summed(_EVEN_RIPPLES, rotated(_EVEN_RIPPLES, 90.0))), 0.45),
    "lattice": _Texture(gaussian(summed(_EVEN_RIPPLES, rotated(_EVEN_RIPPLES, 65.0))), 0.45),
    "peel": _Texture(gaussian(ring(0.06, 0.012)), 0.45),
    # Relief that is not determined by its spectrum.
    "domes": _Texture(_DOMES, 0.45),
    "cobbles": _Texture(_COBBLES, 0.45),
    "ridged": _Texture(ridged(gaussian(ring(0.03, 0.012))), 0.45),
    "crested": _Texture(crested(gaussian(ripples(0.04, 0.008, 0.010))), 0.45),
    # The relief of another class with another albedo.
    "rock_speckled": _Texture(_ROCK, pattern=_Pattern(_SPECKLE, 0.5)),
    "malv_blotched": _Texture(_MALV, pattern=_Pattern(_BLOTCHES, 3.0)),
    "sand_striped": _Texture(_SAND, pattern=_Pattern(gaussian(rotated(_EVEN_RIPPLES, 60.0)), 1.0)),
    "ripples_tinted": _Texture(_FINE_RIPPLES, 0.45, _Pattern(None, 1.0)),
    # A relief and an albedo that no other class has.
    "rock_flecked": _Texture(
        gaussian(fractal(2.8)),
        0.45,
        _Pattern(inverted(shot_noise(mulvaney(0.10), spacing_px=24.0)), 0.8),
    ),
    "marble": _Texture(
        gaussian(mulvaney(0.02)), 0.45, _Pattern(gaussian(ripples(0.025, 0.008, 0.015)), 2.0)
    ),
    "weave_dyed": _Texture(
        gaussian(summed(ripples(0.05, 0.01, 0.01), rotated(ripples(0.10, 0.01, 0.01), 90.0))),
        0.45,
        _Pattern(gaussian(rotated(_EVEN_RIPPLES, 45.0)), 1.0),
    ),
    "ridged_tinted": _Texture(ridged(gaussian(ring(0.05, 0.015))), 0.45, _Pattern(None, 0.7)),
    "ogil_blotched": _Texture(
        gaussian(ogilvy(0.05, 0.10)), 0.45, _Pattern(gaussian(mulvaney(0.06)), 2.0)
    ),
    "peel_stained": _Texture(
        gaussian(ring(0.09, 0.015)), 0.45, _Pattern(gaussian(fractal(1.5)), 1.0)
    ),
}

_TWINS = {
    "pits": _Texture(inverted(_DOMES), 0.45),
    "cobbles_gaussian": _Texture(phase_randomised(_COBBLES), 0.45),
}

_TEXTURES = _THESIS_TEXTURES | _VARIATIONS | _TWINS

SYNTHETIC_NAMES = tuple(_THESIS_TEXTURES)
"""The four of the thesis."""

SYNTHETIC_30 = tuple(_THESIS_TEXTURES | _VARIATIONS)
"""The four and 26 more, for measuring a classifier."""

SYNTHETIC_TEXTURES = tuple(_TEXTURES)
"""All names that `synthetic_surface` accepts: the 30 and 2 twins."""

EQUAL_SPECTRUM_TWINS = {"pits": "domes", "cobbles_gaussian": "cobbles"}
"""Twin to original: two more classes, each with the power spectra of one of the 30.

Pits are inverted domes. The other has the amplitudes of cobbles with random phases.
"""


def tile_side_px(size_px: int) -> int:
    """Side of the tile: a power of two, at least twice the frame so that no part shows twice."""
    side_px = 1 << max(2 * size_px - 1, 1).bit_length()
    return min(max(side_px, _MIN_TILE_PX), _MAX_TILE_PX)


def synthetic_surface(name: str, seed: int, tile_px: int) -> PeriodicSurface:
    """Generate one realisation of a random texture.

    Its statistics do not depend on the size of the tile. It is level on average and scaled to the
    rms slope of its class. The four of the thesis are Gaussian with rms slope `_RMS_SLOPE` and
    constant albedo `ALBEDO`.

    Parameters
    ----------
    name
        One of `SYNTHETIC_TEXTURES`.
    seed
        0 or more. The same seed and side give the same surface; another seed gives another
        realisation of the same texture.
    tile_px
        Side of the tile, 16 to `MAX_SIDE_PX`; see `tile_side_px`.

    Raises
    ------
    InputError
        For an unknown name, a negative seed or a side out of range.
    """
    if name not in _TEXTURES:
        raise InputError(
            f"no synthetic surface is called {name!r}; there are {', '.join(_TEXTURES)}"
        )
    if seed < 0:
        raise InputError(f"seed {seed} of surface {name} is negative; give 0 or more")
    if not 16 <= tile_px <= MAX_SIDE_PX:
        raise InputError(f"a tile of {tile_px} px; its side must be 16 to {MAX_SIDE_PX}")
    texture = _TEXTURES[name]
    # The name is part of the seed, so two textures of one seed do not share their phases.
    rng = np.random.default_rng([seed, zlib.crc32(name.encode())])
    relief = texture.relief(rng, tile_px)
    height = relief.astype(np.float32)
    height *= np.float32(texture.rms_slope / rms_slope(*spectral_gradients(height)))
    if texture.pattern is None:
        return PeriodicSurface.from_height(height, np.full_like(height, ALBEDO), name)
    return PeriodicSurface.from_height(height, texture.pattern.albedo(relief, rng), name)
