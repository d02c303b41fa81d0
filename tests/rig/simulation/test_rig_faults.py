"""The faults of a simulated rig against a plain rendering in numpy."""

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from classify.base.errors import ConfigError
from classify.lighting import Lighting
from rig import Placement, RigConfig, open_rig
from rig.scene.surfaces import PeriodicSurface, View
from rig.scene.synthetic import synthetic_surface, tile_side_px
from rig.simulation.scenes import BoundedCache, SceneRenderer, scene_bytes
from rig.simulation.sensor import SensorModel

Image = npt.NDArray[np.float64]
LEVELS = (1.0, 0.9, 1.1, 0.95)


def rig_with(
    height_px: int = 40, width_px: int = 56, bits: int = 12, **simulation: Any
) -> RigConfig:
    return RigConfig().with_changes(
        camera={"width_px": width_px, "height_px": height_px, "bits": bits},
        simulation=simulation,
    )


def plain_rendering(config: RigConfig, surface: PeriodicSurface) -> Image:
    """The pixel values of each light with the ambient light, (N, H, W), without noise."""
    camera, simulated = config.camera, config.simulation
    rows, cols = camera.height_px, camera.width_px
    size = max(rows, cols)
    patch = surface.patch(View(size))
    top, left = (size - rows) // 2, (size - cols) // 2
    height = patch.height - np.mean(patch.height)
    height, p, q, albedo = (
        plane[top : top + rows, left : left + cols].astype(np.float64)
        for plane in (height, patch.p, patch.q, patch.albedo)
    )
    x = (np.arange(cols) - (cols - 1) / 2)[None, :] + 0.0 * height
    y = ((rows - 1) / 2 - np.arange(rows))[:, None] + 0.0 * height
    normal = np.stack([-p, -q, np.ones_like(p)]) / np.sqrt(1.0 + p * p + q * q)
    missing = 0.01 * simulated.vignetting_percent * (x * x + y * y) / (x * x + y * y).max()
    images = np.empty((len(simulated.led_levels), rows, cols))
    for light, direction in enumerate(config.lights.lighting.directions):
        ray = simulated.led_distance_px * direction[:, None, None] - np.stack([x, y, height])
        distance = np.linalg.norm(ray, axis=0)
        at_surface = np.maximum((normal * ray).sum(0) / distance, 0.0)
        at_led = np.maximum(np.tensordot(direction, ray, 1) / distance, 0.0)
        irradiance = at_surface * at_led * (simulated.led_distance_px / distance) ** 2
        irradiance = simulated.led_levels[light] * irradiance + simulated.ambient
        images[light] = albedo * irradiance * (1.0 - missing)
    full_scale = 2**camera.bits - 1
    # 85 % of the range above the black level of 1/64 in 20 ms.
    linear = np.minimum(1.0 / 64.0 + 63.0 / 64.0 * 0.85 * images * camera.exposure_ms / 20.0, 1.0)
    return np.asarray(np.rint(full_scale * linear ** (1.0 / simulated.response_gamma)))


@settings(deadline=None, max_examples=6)
@given(
    distance_px=st.floats(60.0, 400.0),
    vignetting_percent=st.floats(0.0, 50.0),
    gamma=st.floats(0.5, 3.0),
    bits=st.sampled_from((8, 12)),
    slant_deg=st.floats(20.0, 60.0),
)
def test_the_pixels_are_those_of_a_plain_rendering(
    distance_px: float, vignetting_percent: float, gamma: float, bits: int, slant_deg: float
) -> None:
    config = rig_with(
        bits=bits,
        ambient=0.03,
        led_distance_px=distance_px,
        led_levels=LEVELS,
        vignetting_percent=vignetting_percent,
        response_gamma=gamma,
    ).with_changes(lights={"slant_deg": slant_deg})
    scene = SceneRenderer(config, BoundedCache(scene_bytes, 0)).render(Placement(surface="malv"))
    sensor = SensorModel(
        bit_depth=bits, read_noise_e=0.0, full_well_e=1e12, white_e_per_ms=4.25e10,
        response_gamma=gamma,
    )  # fmt: skip
    rng = np.random.default_rng(0)
    pixels = np.stack(
        [sensor.expose((light + scene.ambient) * 20.0, rng) for light in scene.lights]
    )
    expected = plain_rendering(config, synthetic_surface("malv", 1, tile_side_px(56)))
    lit = ~scene.shadowed
    assert lit.mean() > 0.5
    error = np.abs(pixels - expected)[lit]
    assert error.max() <= 1.0  # float32 rounds a few values to the other side
    assert error.mean() < 0.02


def test_hot_pixels_stay_where_they_are_whatever_is_below_the_camera() -> None:
    config = rig_with(hot_pixels=7, placement={"surface": "lens_cap"})
    with open_rig(config) as rig:
        dark = rig.camera.read(1.0).pixels
        hot = np.flatnonzero(dark > 400)
        rig.simulation.place(Placement(surface="plate", seed=4))  # type: ignore[union-attr]
        for _ in range(6):
            plate = rig.camera.read(1.0).pixels
    assert len(hot) == 7
    np.testing.assert_array_equal(np.flatnonzero(plate > 400), hot)
    assert np.delete(dark, hot).max() < 100  # read noise on a black level of 64


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"led_levels": (1.0, 0.9)}, "led_levels has 2 .* 4 LEDs"),
        (
            {"hot_pixels": 9000},
            "hot_pixels = 9000 .* 2240 pixels; .* 1120",
        ),
        ({"placement": {"size_mm": 3.0}}, "size_mm needs simulation.mm_per_px"),
    ],
)
def test_a_wrong_fault_is_refused_with_its_key(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        rig_with(**changes)


def test_levels_and_vignetting_are_not_told_to_the_solver() -> None:
    config = rig_with(led_levels=LEVELS, vignetting_percent=30.0)
    assert config.lights.lighting == Lighting.ring(45.0)
