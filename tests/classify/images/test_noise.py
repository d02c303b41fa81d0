"""Noise of a set of images of an unknown surface."""

import numpy as np
import pytest

from classify import Lighting
from classify.base.errors import InputError
from classify.images import ImageStack, SensorNoise, noise_of_images
from rig.scene.material_folder import bundled_materials, load_material
from rig.scene.render import Gloss, render_frame

SIDE = 128
ONES = np.ones(4, np.float32)


def images_of_bumps(lighting: Lighting, sigma: float, seed: int = 0) -> np.ndarray:
    """Float32 images of relief and paint, about 100 bright, with Gaussian noise."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(np.arange(SIDE) / 9.0, np.arange(SIDE) / 7.0)
    p, q = 0.3 * np.sin(x), 0.3 * np.cos(x + y)
    normals = np.stack([-p, -q, np.ones_like(p)]) / np.sqrt(1 + p * p + q * q)
    clean = 100.0 * (1 + 0.4 * np.sin(y)) * np.tensordot(lighting.directions, normals, 1)
    return (clean + sigma * rng.standard_normal(clean.shape)).astype(np.float32)


@pytest.mark.parametrize("lights", [4, 5, 8, 20])
@pytest.mark.parametrize("sigma", [0.5, 3.0])
def test_noise_is_found_whatever_the_surface(lights: int, sigma: float) -> None:
    lighting = Lighting.ring(40.0, tilts_deg=np.arange(lights) * 360.0 / lights)
    images = images_of_bumps(lighting, sigma)
    found = noise_of_images(ImageStack(images, None), np.ones(lights, np.float32), lighting)
    assert found == pytest.approx(sigma, rel=0.05)


def test_shadow_on_a_fifth_of_the_pixels_hardly_raises_it() -> None:
    images = images_of_bumps(Lighting.ring(), 2.0)
    images[1, :, : SIDE // 5] = 0.0
    assert noise_of_images(ImageStack(images, None), ONES, Lighting.ring()) == pytest.approx(
        2.0, rel=0.4
    )


def test_an_unknown_led_level_does_not_raise_the_noise_of_dark_pixels() -> None:
    images = images_of_bumps(Lighting.ring(), 0.0)
    images[:, : SIDE // 3] *= 0.02
    images += np.random.default_rng(1).normal(0.0, 0.5, images.shape).astype(np.float32)
    images[2] *= 1.5
    assert noise_of_images(ImageStack(images, None), ONES, Lighting.ring()) == pytest.approx(
        0.6, abs=0.15
    )


def test_noise_is_in_units_of_images_times_gains() -> None:
    images = images_of_bumps(Lighting.ring(), 2.0)
    found = noise_of_images(ImageStack(images, None), ONES / 256, Lighting.ring())
    assert found == pytest.approx(2.0 / 256, rel=0.05)


def test_ambient_light_is_not_noise() -> None:
    general = Lighting.from_angles([0, 80, 200, 265], [30, 45, 50, 40])
    images = images_of_bumps(general, 2.0)
    ambient = np.tile(np.linspace(0, 50, SIDE, dtype=np.float32), (SIDE, 1))
    found = noise_of_images(ImageStack(images + ambient, ambient), ONES, general)
    assert found == pytest.approx(2.0, rel=0.05)


def test_integer_images_have_at_least_rounding_noise() -> None:
    flat = np.full((4, SIDE, SIDE), 90, np.uint8)
    assert noise_of_images(ImageStack(flat, None), ONES, Lighting.ring()) == pytest.approx(
        np.sqrt(1 / 12)
    )
    assert noise_of_images(ImageStack(flat.astype(np.float32), None), ONES, Lighting.ring()) < 1e-4


@pytest.mark.parametrize("step", [4, 16, 64, 257])
def test_values_with_steps_have_at_least_the_noise_of_their_rounding(step: int) -> None:
    """10, 12 or 14 bits in the upper bits of 16, and 8 bits that were stretched to 16."""
    values = 500.0 * images_of_bumps(Lighting.ring(), 0.0)
    images = (step * np.rint(values / step)).astype(np.uint16)
    found = noise_of_images(ImageStack(images, None), ONES, Lighting.ring())
    assert found == pytest.approx(step * np.sqrt(1 / 12), rel=0.2)


@pytest.mark.parametrize(("strength", "exponent"), [(0.1, 8.0), (0.3, 20.0), (0.6, 80.0)])
def test_gloss_is_not_taken_for_noise(strength: float, exponent: float) -> None:
    """Highlights wider than the texture are in most pixels, and no Lambertian surface has them."""
    lighting = Lighting.ring(45.0)
    ground = load_material(bundled_materials()["Ground054"])
    scene = render_frame(ground, lighting, 256, gloss=Gloss(strength, exponent))
    images = scene.lights / scene.lights.max()
    images += 0.002 * np.random.default_rng(0).standard_normal(images.shape)
    found = noise_of_images(ImageStack(images.astype(np.float32), None), ONES, lighting)
    assert 0.0019 < found < 0.005


def test_three_lights_determine_the_rounding_only() -> None:
    lighting = Lighting.ring(40.0, tilts_deg=[0, 120, 240])
    images = images_of_bumps(lighting, 3.0)
    gains = np.array([1, 2, 1], np.float32)
    assert noise_of_images(ImageStack(images, None), gains, lighting) == 0.0
    rounded = noise_of_images(ImageStack(images.astype(np.uint8), None), gains, lighting)
    assert rounded == pytest.approx(2.0 * np.sqrt(1 / 12))


@pytest.mark.parametrize(
    "values",
    [(np.nan, 1, 0), (0, 1, 0), (-1, 1, 0), (1e-300, 1, 0), (np.inf, 1, 0), (8, -1, 0),
     (8, 1e200, 0), (8, 1e20, 0), (8, np.inf, 0), (8, 1, np.nan), (8, 1, 1e300), (8, 1, -1e300)],
)  # fmt: skip
def test_a_sensor_noise_beyond_any_camera_is_refused(values: tuple[float, float, float]) -> None:
    with pytest.raises(InputError, match="sensor noise"):
        SensorNoise(*values)
