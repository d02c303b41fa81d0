"""Whitening of a texture whose low places are dark: what the relief predicts is no stain."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.fft

from classify import SurfaceEstimate, learn_defects
from classify.defects.detectability import KnownDefect, detectability
from classify.defects.fields import part_fields
from classify.defects.whitening import Spectrum, mean_spectrum, white_spectra
from classify.relief.height import integrate_gradients

SIDE = 256
PARTS = 10
STAIN = KnownDefect("stain", 24.0)


@pytest.fixture(scope="module")
def reliefs(stationary) -> list[SurfaceEstimate]:
    return [stationary("malv", seed=seed, side=SIDE) for seed in range(PARTS + 1)]


def dyed_by(surface: SurfaceEstimate, other: SurfaceEstimate) -> SurfaceEstimate:
    """A part that is dark where another is low."""
    height = integrate_gradients(other.p, other.q)
    noise = np.random.default_rng(1).normal(0.0, 0.01, height.shape)
    albedo = 0.5 * np.exp(0.2 * height / height.std() + noise)
    return replace(surface, albedo=albedo.astype(np.float32))


def white_planes(
    surface: SurfaceEstimate, taught: list[SurfaceEstimate], orientation_deg: float = 0.0
) -> list[np.ndarray]:
    gains = mean_spectrum([Spectrum.of(part_fields(part), 0.0) for part in taught]).gains()
    fields = part_fields(surface)
    white, _ = white_spectra(fields, gains, orientation_deg)
    return [scipy.fft.irfft2(spectrum, s=fields.p.shape) for spectrum in white]


def test_the_white_albedo_is_what_the_relief_does_not_predict(
    reliefs: list[SurfaceEstimate],
) -> None:
    parts = [dyed_by(relief, relief) for relief in reliefs]
    relief, albedo = white_planes(parts[0], parts[1:])
    assert abs(np.corrcoef(relief.ravel(), albedo.ravel())[0, 1]) < 0.05
    assert 0.7 < albedo[32:-32, 32:-32].std() / relief[32:-32, 32:-32].std() < 1.3


def test_a_part_that_lies_upside_down_is_whitened_alike(reliefs: list[SurfaceEstimate]) -> None:
    parts = [dyed_by(relief, relief) for relief in reliefs]
    upright = white_planes(parts[0], parts[1:])
    turned = SurfaceEstimate(
        *(np.rot90(plane, 2).copy() for plane in (-parts[0].p, -parts[0].q, parts[0].albedo)),
        np.ones((SIDE, SIDE), np.bool_),
        "",
    )
    for here, there in zip(upright, white_planes(turned, parts[1:]), strict=True):
        np.testing.assert_allclose(np.rot90(there, 2), here, atol=1e-3)


def test_a_stain_is_found_earlier_where_the_relief_predicts_the_albedo(
    reliefs: list[SurfaceEstimate],
) -> None:
    def contrast(others: list[SurfaceEstimate]) -> float:
        parts = [dyed_by(*pair) for pair in zip(reliefs[:PARTS], others, strict=True)]
        model = learn_defects(parts, [None] * PARTS)
        (stated,) = detectability(model, [(part, None) for part in parts], 1.0, (STAIN,))
        return stated.strength or np.inf

    assert contrast(reliefs[:PARTS]) < 0.5 * contrast(reliefs[1:])
