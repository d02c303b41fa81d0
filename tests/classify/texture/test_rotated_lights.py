"""Surfaces solved again under rotated lights."""

from dataclasses import replace

import numpy as np
import pytest

from classify import Lighting, SurfaceEstimate, photometric_stereo
from classify.relief.relighting import cast_shadow, under_rotated_lights


@pytest.fixture(scope="module")
def truth() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Height, p and q of waves along x, steep enough to cast shadows at slant 65."""
    x = np.arange(96)
    height = np.tile(3.0 * np.sin(2 * np.pi * x / 24.0), (96, 1)).astype(np.float32)
    p = np.tile(3.0 * 2 * np.pi / 24.0 * np.cos(2 * np.pi * x / 24.0), (96, 1))
    return height, p.astype(np.float32), np.zeros((96, 96), np.float32)


def solved(truth, lighting: Lighting, method="ps4") -> SurfaceEstimate:
    height, p, q = truth
    normals = np.stack([-p, -q, np.ones_like(p)], axis=-1) / np.sqrt(1 + p**2 + q**2)[..., None]
    images = 0.6 * np.maximum(np.einsum("nk,hwk->nhw", lighting.directions, normals), 0.0)
    images = images.astype(np.float32)
    for image, direction in zip(images, lighting.directions, strict=True):
        image[cast_shadow(height, direction)] = 0.0
    return photometric_stereo(images, lighting, method)


def test_a_surface_in_shadow_gives_three_estimates(truth) -> None:
    surface = solved(truth, Lighting.ring(65.0))
    assert surface.shadow_mask.mean() > 0.1
    others = list(under_rotated_lights(surface))
    assert len(others) == 3
    for step, other in enumerate(others, start=1):
        assert other.shape == surface.shape
        assert other.method == surface.method
        expected = Lighting.ring(65.0, tuple((t - 22.5 * step) % 360 for t in (0, 90, 180, 270)))
        assert other.lighting.within(1e-4, expected)


def test_estimates_are_those_of_the_true_surface_under_rotated_lights(truth) -> None:
    """They are nearer to these than the estimate they come from."""
    surface = solved(truth, Lighting.ring(65.0))
    for step, other in enumerate(under_rotated_lights(surface), start=1):
        tilts = tuple(tilt - 22.5 * step for tilt in (0.0, 90.0, 180.0, 270.0))
        true = solved(truth, Lighting.from_angles(tilts, 65.0))
        both = true.valid & other.valid & surface.valid
        shares = [float(np.median(np.abs(each.p - true.p)[both])) for each in (other, surface)]
        assert shares[0] <= shares[1] + 0.02
        # The shadows lie where those of the true surface lie.
        agreed = np.mean(other.shadow_mask == true.shadow_mask)
        assert agreed > 0.8


@pytest.mark.parametrize("change", ["no lights", "ps3", "no shadow", "another method"])
def test_surfaces_that_rotated_lights_would_not_change_give_none(truth, change: str) -> None:
    surface = solved(truth, Lighting.ring(65.0), "ps3a" if change == "ps3" else "ps4")
    if change == "no lights":
        surface = replace(surface, lighting=None)
    elif change == "no shadow":
        surface = solved(truth, Lighting.ring(30.0))
        assert not surface.shadow_mask.any()
    elif change == "another method":
        surface = replace(surface, method="by hand")
    assert list(under_rotated_lights(surface)) == []
