"""Agreement of four light images, on surfaces whose truth is known."""

import numpy as np
import numpy.typing as npt
import pytest

from classify import Lighting
from classify.images import SensorNoise
from classify.lights.agreement import image_difference, light_agreement, split_by_redundancy_sign

Images = npt.NDArray[np.uint16]
LIGHTING = Lighting.ring(45.0)
NOISE = SensorNoise(gain_e_per_dn=2.5, read_noise_dn=2.0, black_level_dn=64.0)
SIDE = 96


def bumps(slope: float = 0.4) -> npt.NDArray[np.float64]:
    """(4, H, W) images of a matt relief without noise, with 40 of ambient light."""
    y, x = np.mgrid[:SIDE, :SIDE] * (2.0 * np.pi / 16.0)
    p, q = slope * np.cos(x) * np.cos(0.7 * y), slope * np.sin(1.3 * y + x)
    normals = np.stack([-p, -q, np.ones_like(p)]) / np.sqrt(1.0 + p * p + q * q)
    return 2000.0 * np.tensordot(LIGHTING.directions, normals, 1)


def exposed(light: npt.NDArray[np.float64], seed: int = 1) -> Images:
    """Pixel values with the noise of the sensor."""
    rng = np.random.default_rng(seed)
    noise = np.sqrt(light / NOISE.gain_e_per_dn + NOISE.read_noise_dn**2)
    values = 64.0 + light + noise * rng.standard_normal(light.shape)
    return np.clip(np.rint(values), 0, 4095).astype(np.uint16)


AMBIENT = exposed(np.full((SIDE, SIDE), 40.0), 99)


def agreement(light: npt.NDArray[np.float64], noise: SensorNoise | None = NOISE) -> tuple:
    found = light_agreement(exposed(light + 40.0), LIGHTING, AMBIENT, 4095, noise)
    return found.redundancy_residual, found.levels, found.level_error, found.compared_rows


@pytest.mark.parametrize("noise", [NOISE, None], ids=["known noise", "unknown noise"])
def test_a_matt_surface_agrees_with_itself(noise: SensorNoise | None) -> None:
    residual, levels, error, compared = agreement(bumps(), noise)
    assert residual == 0.0
    assert levels == pytest.approx((1.0,) * 4, abs=0.004)
    assert error < 0.003
    assert compared == 1.0


@pytest.mark.parametrize("share", [0.97, 0.9, 0.5, 0.3])
def test_a_weak_light_is_measured(share: float) -> None:
    light = bumps()
    light[2] *= share
    residual, levels, _, _ = agreement(light)
    assert residual == 0.0
    assert levels == pytest.approx((1.0, 1.0, share, 1.0), abs=0.006)


def test_known_intensities_are_divided_out() -> None:
    uneven = Lighting(LIGHTING.directions, np.array([1.0, 0.5, 0.8, 1.2]))
    light = bumps() * uneven.intensities[:, None, None]
    found = light_agreement(exposed(light + 40.0), uneven, AMBIENT, 4095, NOISE)
    assert found.redundancy_residual == 0.0
    assert found.levels == pytest.approx((1.0,) * 4, abs=0.006)


@pytest.mark.parametrize("rows", [1, 5, 48, 90])
def test_rows_of_another_light_disagree(rows: int) -> None:
    light = bumps()
    light[1, -rows:] = light[0, -rows:]
    residual, _, _, _ = agreement(light)
    truth = bumps()
    wrong = np.sqrt(((light[1] - truth[1]) ** 2).mean() / (truth**2).mean())
    assert residual > 0.5 * wrong


def test_a_level_surface_determines_no_levels() -> None:
    residual, levels, error, compared = agreement(bumps(0.0))
    assert residual == 0.0
    assert levels is None or error > 0.1
    assert compared == 1.0


def test_a_near_light_has_no_single_level() -> None:
    light = bumps()
    light[0] *= np.linspace(0.8, 1.2, SIDE)
    _, levels, _, _ = agreement(light)
    assert levels is None


def test_glints_and_shadows_are_tolerated() -> None:
    light = bumps()
    light[0, 10:14, 10:20] = 4000.0
    light[3, 40:60, 40:60] = 0.0
    residual, levels, _, _ = agreement(light)
    assert residual < 0.02
    assert levels == pytest.approx((1.0,) * 4, abs=0.01)


def test_opposite_lights_of_a_ring_have_weights_of_one_sign() -> None:
    assert split_by_redundancy_sign(LIGHTING) == ((0, 2), (1, 3))
    opposite_neighbours = Lighting.ring(40.0, (0.0, 180.0, 90.0, 270.0))
    assert split_by_redundancy_sign(opposite_neighbours) == ((0, 1), (2, 3))
    assert split_by_redundancy_sign(Lighting.ring(40.0, (0.0, 120.0, 240.0))) == ((0, 1), (2,))


def test_two_images_of_one_scene_differ_by_noise_only() -> None:
    scene = bumps()[0]
    assert image_difference(exposed(scene, 1), exposed(scene, 2), 1400.0, NOISE) == 0.0


def test_images_of_one_column_can_be_compared() -> None:
    scene = bumps()[0][:, :1]
    assert image_difference(exposed(scene, 1), exposed(scene, 1), 1400.0, None) == 0.0


@pytest.mark.parametrize("gain", [1.03, 0.9])
def test_two_images_differ_by_the_change_of_light(gain: float) -> None:
    scene = bumps()[0]
    signal = float(np.sqrt((scene**2).mean()))
    found = image_difference(exposed(scene, 1), exposed(gain * scene, 2), signal, NOISE)
    # The scaled median gives up to 1.48 times the rms where the difference is not noise.
    assert 0.9 < found / abs(gain - 1.0) < 1.5


def test_one_row_of_another_light_is_noticed() -> None:
    scene = bumps()[0]
    torn = scene.copy()
    torn[-1] *= 0.4
    found = image_difference(exposed(scene, 1), exposed(torn, 2), float(scene.mean()), NOISE)
    assert 0.9 < found / (0.6 / np.sqrt(SIDE)) < 1.7
