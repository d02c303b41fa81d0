"""Solvers on images that do not show a surface: no crash, no invented slopes."""

import warnings

import numpy as np
import pytest

from classify import METHODS, Lighting, Method, SurfaceEstimate, photometric_stereo


def lights_for(method: Method) -> Lighting:
    return Lighting.ring(45.0, np.arange(5) * 72.0) if method == "rushmeier" else Lighting.ring()


def solved(method: Method, images: np.ndarray, **more: object) -> SurfaceEstimate:
    lighting = lights_for(method)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        surface = photometric_stereo(images[: len(lighting)], lighting, method, **more)
    for name in ("p", "q", "albedo", "residual"):
        values = getattr(surface, name)
        assert values.dtype == np.float32
        assert np.isfinite(values).all(), name
    assert surface.shape == images.shape[1:]
    return surface


def five(value: float, dtype: type = np.uint16, shape: tuple[int, int] = (24, 31)) -> np.ndarray:
    return np.full((5, *shape), value, dtype)


pytestmark = pytest.mark.parametrize("method", METHODS)


@pytest.mark.parametrize("shape", [(24, 31), (1, 1)])
def test_constant_images_are_a_level_surface(method: Method, shape: tuple[int, int]) -> None:
    surface = solved(method, five(800, shape=shape), full_scale=4095)
    np.testing.assert_allclose(surface.p, 0.0, atol=1e-5)
    np.testing.assert_allclose(surface.q, 0.0, atol=1e-5)
    np.testing.assert_allclose(surface.albedo, 800 / 4095 * np.sqrt(2), rtol=1e-5)
    assert surface.valid.all()
    assert not surface.shadow_mask.any()
    assert not surface.specular.any()


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_black_images_have_no_valid_pixel(method: Method, dtype: type) -> None:
    surface = solved(method, five(0, dtype))
    assert not surface.valid.any()
    assert not surface.repaired.any()
    assert (surface.p == 0).all()
    assert (surface.q == 0).all()
    assert np.abs(surface.albedo).max() < 1e-6
    # Nothing is predicted where no slope is known.
    assert not surface.shadow_mask.any()


def test_images_darker_than_the_ambient_image_have_no_valid_pixel(method: Method) -> None:
    surface = solved(method, five(50), ambient=np.full((24, 31), 90, np.uint16))
    assert not surface.valid.any()
    assert (surface.p == 0).all()


def test_saturated_images_have_no_valid_pixel(method: Method) -> None:
    surface = solved(method, five(255, np.uint8), full_scale=255)
    assert surface.saturated.all()
    assert not surface.valid.any()
    assert not surface.repaired.any()


def test_a_black_image_is_a_shadow_everywhere(method: Method) -> None:
    """As of a failed LED; methods that leave out one light still solve."""
    images = five(800)
    images[1] = 0
    surface = solved(method, images, full_scale=4095)
    if method in ("ps4", "ps4_robust", "drbohlav"):
        np.testing.assert_allclose(surface.p, 0.0, atol=0.01)
        np.testing.assert_allclose(surface.q, 0.0, atol=0.01)
        assert (surface.dropped == 1).all()
        assert (surface.shadow_count == 1).all()
        assert surface.valid.all()
    if method.startswith("ps3"):
        # Right without light 1 (ps3c), not valid with it.
        unused = int(surface.dropped[0, 0])
        assert surface.valid.all() == (unused == 1)
        assert surface.valid.any() == (unused == 1)


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (7, 1), (2, 2), (3, 500), (33, 17)])
def test_frames_of_any_shape_are_solved(method: Method, shape: tuple[int, int]) -> None:
    images = five(800, shape=shape)
    images[:4] += np.array([100, 50, 0, 50], np.uint16)[:, None, None]
    images[0, 0, 0] = images[1, 0, 0] = 0
    surface = solved(method, images, full_scale=4095)
    reference = solved(method, images[:, :, -1:], full_scale=4095)
    np.testing.assert_allclose(surface.p[:, -1], reference.p[:, 0], atol=2e-5)


@pytest.mark.parametrize("slope", [0.9, 0.99, 1.0, 1.01, 3.0, 20.0])
def test_slopes_near_the_limit_of_visibility(method: Method, slope: float) -> None:
    """Beyond slope 1 the surface faces away from one light, soon from three."""
    lighting = lights_for(method)
    normal = np.array([-slope, -0.05, 1.0]) / np.hypot(slope, 1.00125)
    lit = np.maximum(60_000.0 * lighting.directions @ normal, 0.0)
    images = np.zeros((5, 40, 40), np.uint16)
    images[: len(lighting)] = np.round(lit)[:, None, None]
    surface = solved(method, images, full_scale=65_535)
    assert (np.hypot(surface.p, surface.q) <= 50.0 * np.sqrt(2.0)).all()
    # PS3 cannot tell a light that gives next to nothing from shadow, and has no other.
    if slope < (0.95 if method.startswith("ps3") else 1.0) and method != "rushmeier":
        assert surface.valid.all()
        np.testing.assert_allclose(surface.p, slope, rtol=0.02)
    if method in ("ps4", "ps4_robust") and slope == 1.01:
        np.testing.assert_allclose(surface.p, slope, rtol=0.02)
        assert surface.valid.all()
    if slope == 20.0 and method == "ps4":
        assert not surface.valid.any()
    if slope == 20.0 and method == "ps4_robust":
        # Two lights graze it at 3 % of their intensity, which is far above this noise.
        np.testing.assert_allclose(surface.p, slope, rtol=0.01)


def test_random_images_give_finite_maps(method: Method) -> None:
    rng = np.random.default_rng(5)
    images = rng.integers(0, 65_536, (5, 64, 64)).astype(np.uint16)
    surface = solved(method, images, full_scale=65_535, ambient=images[0] // 3)
    assert surface.valid.mean() < 1.0
    noisy = rng.standard_normal((5, 64, 64)).astype(np.float32)
    solved(method, noisy)
    solved(method, 1e-30 * noisy)
    solved(method, 1e9 * np.abs(noisy))
