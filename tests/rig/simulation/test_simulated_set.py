"""Simulated sets: exposure, LED levels, and images without shadow."""

import numpy as np

from classify import Lighting
from rig.scene.render import render_frame
from rig.scene.synthetic import synthetic_surface
from rig.simulation.sensor import SensorModel
from rig.simulation.simulated_set import EXPOSURE_MS, SimulatedSet

STEEP = Lighting.ring(70.0)
SAND = render_frame(synthetic_surface("sand", 3, 256), STEEP, 128, rotate_deg=20.0)


def test_without_shadow_three_lights_give_the_true_slopes() -> None:
    assert SAND.shadowed.mean() > 0.1
    assert not SAND.without_shadow(STEEP).shadowed.any()
    clean, shadowed = (
        SimulatedSet.expose(SAND, STEEP, SensorModel(), 1, shadows=shadows)
        for shadows in (False, True)
    )
    assert clean.ambient is not None
    assert clean.images.min() < np.median(clean.ambient)  # negative light is kept
    error, shadow_error = (
        np.abs(images.solve("ps3a").p - SAND.p).mean() for images in (clean, shadowed)
    )
    assert error < 0.03
    assert shadow_error > 3.0 * error


def test_the_images_without_shadow_are_the_same_where_there_is_none() -> None:
    lit = ~SAND.shadowed
    np.testing.assert_array_equal(SAND.without_shadow(STEEP).lights[lit], SAND.lights[lit])


def test_exposure_and_led_levels_scale_the_images() -> None:
    sensor = SensorModel(bit_depth=16)
    usual, half, weak = (
        SimulatedSet.expose(SAND, STEEP, sensor, 1, **changed).images.mean(axis=(1, 2))
        for changed in ({}, {"exposure_ms": EXPOSURE_MS / 2}, {"led_levels": (1.0, 0.95, 1, 1)})
    )
    black = sensor.black_level_dn
    np.testing.assert_allclose((half - black) / (usual - black), 0.5, atol=0.01)
    np.testing.assert_allclose((weak / usual)[[0, 2, 3]], 1.0, atol=0.005)
    assert 0.94 < weak[1] / usual[1] < 0.97
