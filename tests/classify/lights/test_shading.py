"""The order of lights, the scene and shifts of photographs, by their shading."""

import json
from collections.abc import Callable
from itertools import combinations
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from capture.sets.light_list import load_light_list
from classify import Lighting, SurfaceEstimate
from classify.lights.shading import (
    explained_detail,
    shading_of,
    shading_order,
    shift_of_one_image,
)

DATA = Path(__file__).parents[2] / "data"
BUTTERFLY = DATA / "butterfly_crop"
RING = Lighting.ring(45.0)
OPPOSITE = [2, 3, 0, 1]
WRONG = ([2, 1, 0, 3], [0, 3, 2, 1], [1, 0, 2, 3], [1, 2, 3, 0], [3, 2, 1, 0])
Texture = Callable[..., SurfaceEstimate]


def estimate(p: np.ndarray, q: np.ndarray, albedo: np.ndarray) -> SurfaceEstimate:
    return SurfaceEstimate(p, q, albedo, np.ones(p.shape, np.bool_), "least_squares")


def images_of(surface: SurfaceEstimate, lighting: Lighting, noise: float = 100.0) -> np.ndarray:
    shading = np.einsum("nk,hwk->nhw", lighting.directions, surface.normals).clip(0.0)
    noises = np.random.default_rng(5).normal(0.0, noise, shading.shape)
    return (surface.albedo * shading * 40_000 + 1000 + noises).clip(0, 65_535).astype(np.uint16)


@pytest.fixture(scope="module")
def relief(stationary: Texture) -> SurfaceEstimate:
    return stationary("domes", orientation_deg=20.0, seed=3, side=192)


@pytest.fixture(scope="module")
def butterfly() -> tuple[np.ndarray, np.ndarray]:
    """(8, 128, 128) photographs less ambient light, and (8, 3) light directions."""
    entries = json.loads((BUTTERFLY / "lights.json").read_text())["images"]
    names = [str(BUTTERFLY / entry["file"]) for entry in entries]
    images = np.stack([cv2.imread(name, cv2.IMREAD_GRAYSCALE) for name in names])
    ambient = cv2.imread(str(BUTTERFLY / "ambient.png"), cv2.IMREAD_GRAYSCALE)
    return images.astype(np.float32) - ambient, np.array([entry["direction"] for entry in entries])


def verdict(images: np.ndarray, directions: np.ndarray) -> str:
    return shading_order(shading_of(images, full_scale=65_535), Lighting(directions)).verdict


def test_near_weak_glossy_lights_in_their_order_are_confirmed(relief: SurfaceEstimate) -> None:
    """Light and LED levels that vary by half, and gloss."""
    side = np.linspace(0.0, 1.0, 192)
    falls_off = (1.2 - 0.6 * side, 0 * side + 1.0, 0.6 + 0.6 * side, 1.3 - 0.5 * side**2)
    near = np.stack([np.tile(each, (192, 1)) for each in falls_off])
    weak = np.array([1.0, 0.5, 0.9, 1.1])[:, None, None]
    values = images_of(relief, RING) * near * weak
    values[values >= np.quantile(values.max(axis=0), 0.98)] *= 2.0
    assert verdict(values, RING.directions) == "confirmed"
    for order in WRONG:
        found = shading_order(shading_of(values), Lighting(RING.directions[order]))
        assert found.verdict == "refuted"
        right = [order[light] for light in found.better or ()]
        assert right in ([0, 1, 2, 3], OPPOSITE)
    assert verdict(values, RING.directions[OPPOSITE]) == "confirmed"


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 3), st.booleans(), st.permutations(range(4)))
def test_the_verdict_is_the_same_for_rotated_and_mirrored_images(
    relief: SurfaceEstimate, turns: int, mirrored: bool, order: list[int]
) -> None:
    images, directions = images_of(relief, RING), RING.directions[order]
    before = verdict(images, directions)
    images = np.rot90(images, turns, axes=(1, 2))
    for _ in range(turns):
        directions = directions[:, [1, 0, 2]] * (-1.0, 1.0, 1.0)
    if mirrored:
        images, directions = images[:, :, ::-1], directions * (-1.0, 1.0, 1.0)
    assert verdict(np.ascontiguousarray(images), directions) == before


def test_images_that_do_not_show_relief_decide_nothing(stationary: Texture) -> None:
    rng = np.random.default_rng(3)
    flat = rng.normal(20_000.0, 600.0, (4, 160, 160))
    painted = flat * rng.uniform(0.4, 1.0, (160, 160))
    across = stationary("sand", seed=2, side=160)
    ridges = estimate(across.p.mean(axis=0) + 0 * across.p, 0 * across.p, 0 * across.p + 0.6)
    for images in (flat, painted, np.zeros((4, 160, 160)), np.full((4, 160, 160), 7.0)):
        for order in ([0, 1, 2, 3], *WRONG):
            assert verdict(images, RING.directions[order]) == "undecided"
    # Lights 1 and 3 give the same image of ridges, and 0 and 2 that of inverted ridges.
    for order in ([0, 1, 2, 3], [2, 1, 0, 3], [0, 3, 2, 1], OPPOSITE):
        assert verdict(images_of(ridges, RING), RING.directions[order]) != "refuted"


@pytest.mark.parametrize("picked", [[6, 0, 2, 4], [7, 1, 3, 5], [7, 1, 3, 4]])
def test_four_photographs_refute_exchanged_lights(
    butterfly: tuple[np.ndarray, np.ndarray], picked: list[int]
) -> None:
    images, directions = butterfly
    assert verdict(images[picked], directions[picked]) == "confirmed"
    for order in WRONG:
        assert verdict(images[picked], directions[picked][order]) == "refuted"


def test_many_photographs_refute_exchanged_shifted_and_mirrored_lights(
    butterfly: tuple[np.ndarray, np.ndarray],
) -> None:
    images, directions = butterfly
    shading = shading_of(images)
    assert shading_order(shading, Lighting(directions)).verdict == "confirmed"
    for first, second in ((0, 6), (1, 4), (3, 7), (1, 6)):
        order = [*range(8)]
        order[first], order[second] = second, first
        assert shading_order(shading, Lighting(directions[order])).better == tuple(order)
    for other in (directions[::-1], np.roll(directions, 1, axis=0)):
        assert shading_order(shading, Lighting(other)).verdict == "refuted"


@pytest.mark.parametrize("count", [4, 6])
def test_an_order_that_no_surface_fits_refutes_none(count: int) -> None:
    """Images that vary with two parameters, as by slopes, but of no surface: gloss may do so."""
    rng = np.random.default_rng(3)
    p, q = (cv2.GaussianBlur(rng.normal(0.0, 1.5, (192, 192)), (0, 0), 3.0) for _ in range(2))
    ring = Lighting.ring(45.0, [360.0 / count * k for k in range(count)])
    images = images_of(estimate(p, q, np.ones((192, 192))), ring)
    order = [1, 0, *range(2, count)]
    assert verdict(images, ring.directions[order]) == "undecided"


@pytest.mark.parametrize("picked", [[6, 0, 3], [6, 0, 3, 5], [*range(8)]])
@pytest.mark.parametrize(
    ("axes", "signs", "name"),
    [
        ([0, 1, 2], (1.0, -1.0, 1.0), "y pointing down"),
        ([1, 0, 2], (1.0, 1.0, 1.0), "x and y exchanged"),
        ([1, 0, 2], (-1.0, 1.0, 1.0), "a rotation by 90 degrees"),
    ],
)
def test_wrong_axes_of_the_lights_are_refuted(
    butterfly: tuple[np.ndarray, np.ndarray],
    picked: list[int],
    axes: list[int],
    signs: tuple[float, ...],
    name: str,
) -> None:
    images, directions = butterfly[0][picked], butterfly[1][picked]
    found = shading_order(shading_of(images), Lighting(directions[:, axes] * signs))
    assert found.verdict == "refuted"
    if len(picked) > 4:  # of three or four, another order may fit as well
        assert found.better == name


def test_an_image_of_another_scene_is_not_explained(
    butterfly: tuple[np.ndarray, np.ndarray], stationary: Texture
) -> None:
    images = butterfly[0][[6, 0, 2, 4]]
    assert explained_detail(shading_of(images)).min() > 0.7
    other = images_of(stationary("malv", seed=9, side=128), RING)[1] // 256
    for wrong in (other, images[1][::-1, ::-1], np.roll(images[1], (12, 12), (0, 1))):
        mixed = images.copy()
        mixed[1] = wrong
        assert explained_detail(shading_of(mixed))[1] < 0.3


def test_noise_is_no_detail(relief: SurfaceEstimate) -> None:
    rng = np.random.default_rng(4)
    noise = rng.normal(1000.0, 60.0, (4, 200, 200))
    assert explained_detail(shading_of(noise)).tolist() == [1.0] * 4
    noisy = images_of(relief, RING, noise=8000.0)
    assert explained_detail(shading_of(noisy)).min() > 0.3


def test_pixels_outside_the_mask_and_saturated_ones_do_not_count(relief: SurfaceEstimate) -> None:
    images = images_of(relief, RING)
    mask = np.zeros(images.shape[1:], np.bool_)
    mask[:, 70:] = True
    images[:, :, :60] = np.random.default_rng(1).integers(0, 50_000, (4, 192, 60))
    images[1, 100:110] = 65_535
    shading = shading_of(images, full_scale=65_535, mask=mask)
    assert shading_order(shading, RING).verdict == "confirmed"
    assert explained_detail(shading).min() > 0.75
    nothing = shading_of(images, full_scale=0)
    assert shading_order(nothing, RING).verdict == "undecided"
    assert explained_detail(nothing).size == 0


@pytest.mark.parametrize("name", ["butterfly_crop", "cat_crop"])
def test_a_shift_of_one_photograph_is_found_and_true_ones_have_none(name: str) -> None:
    lights = load_light_list(DATA / name / "lights.json")
    paths = lights.image_paths()
    photographs = np.stack([cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) for path in paths])
    black = np.zeros(photographs.shape[1:], np.uint8)
    true, shifted = [], []
    picks = [
        pick
        for count in (4, 6)
        for pick in [*combinations(range(len(paths)), count)][:: 4 * len(paths) - 30]
    ]
    for pick in picks:
        images = photographs[list(pick)]
        lighting = lights.lighting_for([paths[k] for k in pick])
        if np.linalg.svd(lighting.directions)[1][2] < 0.15:
            continue  # nearly in one plane
        true.append(shift_of_one_image(images, black, lighting, 255))
        images[1] = np.roll(images[1], 3, axis=1)
        shifted.append(shift_of_one_image(images, black, lighting, 255))
    assert true == [None] * len(true)
    found = [shift for shift in shifted if shift is not None]
    assert len(found) > 0.5 * len(shifted)
    assert np.median(found) == pytest.approx(3.0, abs=1.0)
