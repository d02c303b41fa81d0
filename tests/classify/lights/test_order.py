"""The order of lights, tested by their images."""

import itertools
import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from classify import InputError, Lighting, SurfaceEstimate
from classify.lights.order import light_order

RING = Lighting.ring(45.0)
OPPOSITE = (2, 3, 0, 1)
BUTTERFLY = Path(__file__).parents[2] / "data" / "butterfly_crop"
ORDERS = list(itertools.permutations(range(4)))
Texture = Callable[..., SurfaceEstimate]


def images_of(p: np.ndarray, q: np.ndarray, albedo: np.ndarray, lighting: Lighting) -> np.ndarray:
    """Images with noise of a few per mille, without cast shadows."""
    normals = np.stack([-p, -q, np.ones_like(p)], axis=-1) / np.sqrt(1 + p**2 + q**2)[..., None]
    shading = np.maximum(np.einsum("nk,hwk->nhw", lighting.directions, normals), 0.0)
    shading *= lighting.intensities[:, None, None]
    noise = np.random.default_rng(5).normal(0.0, 100.0, shading.shape)
    return np.clip(albedo * shading * 40_000 + 1000 + noise, 0, 65_535).astype(np.uint16)


@pytest.fixture(scope="module", params=["domes", "brushed"])
def images(request: pytest.FixtureRequest, stationary: Texture) -> np.ndarray:
    surface = stationary(request.param, orientation_deg=20.0, seed=3, side=160)
    return images_of(surface.p, surface.q, surface.albedo, RING)


def test_the_right_order_is_confirmed(images: np.ndarray) -> None:
    result = light_order(images, RING)
    assert result.is_confirmed
    assert not result.is_refuted
    assert {*result.plausible} == {(0, 1, 2, 3), OPPOSITE}
    assert result.opposite == OPPOSITE
    assert result.excess < 1e-3


@pytest.mark.parametrize("order", [o for o in ORDERS if o not in ((0, 1, 2, 3), OPPOSITE)])
def test_every_other_order_is_refuted_and_found_up_to_180_degrees(
    images: np.ndarray, order: tuple[int, ...]
) -> None:
    result = light_order(images[list(order)], RING)
    assert result.is_refuted
    assert not result.is_confirmed
    assert result.excess > 0.15
    assert {*result.plausible} == {order, tuple(OPPOSITE[light] for light in order)}


def test_a_level_surface_decides_nothing() -> None:
    rng = np.random.default_rng(2)
    flat = np.zeros((128, 128))
    albedo = np.kron(rng.uniform(0.2, 0.9, (16, 16)), np.ones((8, 8)))
    result = light_order(images_of(flat, flat, albedo, RING), RING)
    assert not result.is_refuted
    assert not result.is_confirmed
    assert len(result.plausible) > 12


def test_ridges_along_one_axis_do_not_decide_their_sides() -> None:
    x = np.arange(160)
    p = np.broadcast_to(0.4 * np.sin(0.3 * x + np.sin(0.05 * x)), (160, 160))
    images = images_of(p, np.zeros_like(p), np.full_like(p, 0.6), RING)
    result = light_order(images, RING)
    # Lights 1 and 3 gave the same image, and 0 and 2 that of inverted ridges.
    assert {*result.plausible} == {(0, 1, 2, 3), (0, 3, 2, 1), (2, 1, 0, 3), OPPOSITE}
    assert not result.is_refuted
    assert not result.is_confirmed
    assert light_order(images[[1, 0, 3, 2]], RING).is_refuted


def test_weak_and_near_lights_ambient_light_and_gloss_do_not_mislead(images: np.ndarray) -> None:
    side = np.linspace(-0.5, 0.5, images.shape[1])
    x, y = side[None, :], -side[:, None]
    stands = 3.0 * RING.directions
    near = np.stack(
        [27.0 / ((lx - x) ** 2 + (ly - y) ** 2 + lz**2) ** 1.5 for lx, ly, lz in stands]
    )
    weak = np.array([1.0, 0.5, 0.9, 1.1])[:, None, None]
    values = images * near * weak
    brightest = values >= np.quantile(values.max(axis=0), 0.98)
    values[brightest & (values == values.max(axis=0))] *= 2.0
    damaged = (0.5 * values + 2000.0).clip(0, 65_535).astype(np.uint16)
    assert light_order(damaged, RING).is_confirmed
    assert light_order(damaged[[0, 3, 2, 1]], RING).is_refuted
    assert light_order(damaged[[1, 0, 2, 3]], RING).is_refuted


def test_saturated_pixels_are_left_out(stationary: Texture) -> None:
    surface = stationary("malv", seed=1, side=128)
    images = images_of(surface.p, surface.q, surface.albedo, RING)
    images[:, :40] = 65_535
    assert light_order(images, RING, full_scale=65_535).is_confirmed
    images[:] = 65_535
    assert len(light_order(images, RING, full_scale=65_535).plausible) == 24


def test_errors_of_the_light_positions_are_tolerated(stationary: Texture) -> None:
    surface = stationary("malv", seed=2, side=160)
    lights = Lighting.from_angles([3.0, 86.0, 184.0, 265.0], [47.0, 41.0, 44.0, 50.0])
    images = images_of(surface.p, surface.q, surface.albedo, lights)
    assert light_order(images, RING).is_confirmed
    assert light_order(images[[2, 1, 0, 3]], RING).is_refuted


def test_lights_that_are_not_two_opposite_pairs_decide_nothing(stationary: Texture) -> None:
    surface = stationary("malv", seed=2, side=64)
    for tilts in ((0.0, 60.0, 120.0, 180.0), (0.0, 20.0, 190.0, 10.0)):
        lights = Lighting.from_angles(tilts, [45.0, 45.0, 45.0, 30.0])
        images = images_of(surface.p, surface.q, surface.albedo, lights)
        result = light_order(images, lights)
        assert {*result.plausible} == {*ORDERS}
        assert not result.is_refuted
        assert not result.is_confirmed


def test_photographs_under_a_measured_ring(photographs: np.ndarray) -> None:
    """The lights of images 6, 0, 2 and 4 are 11.6 to 13 degrees from the axis."""
    images = json.loads((BUTTERFLY / "lights.json").read_text())["images"]
    directions = np.array([image["direction"] for image in images])
    for chosen in ([6, 0, 2, 4], [7, 1, 3, 5]):
        lights = Lighting(directions[chosen])
        result = light_order(photographs[chosen], lights, full_scale=255)
        assert result.is_confirmed
        for order in ((0, 3, 2, 1), (2, 1, 0, 3), (1, 0, 2, 3), (1, 0, 3, 2), (1, 2, 3, 0)):
            again = light_order(photographs[chosen][list(order)], lights, full_scale=255)
            assert again.is_refuted


@pytest.fixture(scope="module")
def photographs() -> np.ndarray:
    """(8, 128, 128) uint8."""
    names = [str(BUTTERFLY / f"image{number}.png") for number in range(8)]
    return np.stack([cv2.imread(name, cv2.IMREAD_GRAYSCALE) for name in names])


@settings(max_examples=10, deadline=None)
@given(st.floats(-15.0, 15.0), st.floats(25.0, 65.0), st.permutations(range(4)))
def test_the_result_does_not_depend_on_the_numbering_of_lights(
    rotation_deg: float, slant_deg: float, order: list[int]
) -> None:
    """For a rotated ring with its images and lights in any order."""
    rng = np.random.default_rng(7)
    waves = rng.normal(size=(40, 2)) * 0.12
    y, x = np.mgrid[48:-48:-1, -48:48]
    phase = waves[:, :1, None] * x + waves[:, 1:, None] * y + rng.uniform(0, 6.3, (40, 1, 1))
    p, q = (0.15 * np.tensordot(waves[:, axis] / 0.12, np.cos(phase), 1) for axis in (0, 1))
    lights = Lighting.ring(slant_deg, tuple(90.0 * np.array(order) + rotation_deg))
    assert light_order(images_of(p, q, np.full_like(p, 0.6), lights), lights).is_confirmed


def test_other_numbers_of_lights_are_refused() -> None:
    with pytest.raises(InputError, match=r"3 lights .*give 4"):
        light_order(np.zeros((3, 64, 64), np.uint8), Lighting.ring(45.0, (0.0, 120.0, 240.0)))
    with pytest.raises(InputError, match="3 images for 4 lights"):
        light_order(np.zeros((3, 64, 64), np.uint8), RING)
