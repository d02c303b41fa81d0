"""Rates at which exchanged lights are noticed, and correct ones suspected.

``pytest tests/rig/test_light_order_rates.py -s`` prints the table.
"""

from collections import Counter
from collections.abc import Iterator

import numpy as np
import pytest

from classify import Lighting
from classify.lights.order import light_order
from rig.scene.material_folder import bundled_materials, load_material
from rig.scene.render import SceneImages, render_frame
from rig.scene.synthetic import SYNTHETIC_30, synthetic_surface
from rig.simulation.sensor import SensorModel

EXCHANGED = {
    "opposite pair 0, 2": (2, 1, 0, 3),
    "opposite pair 1, 3": (0, 3, 2, 1),
    "neighbours 0, 1": (1, 0, 2, 3),
    "neighbours 1, 2": (0, 2, 1, 3),
    "all by one place": (1, 2, 3, 0),
    "neighbours 0, 1 and 2, 3": (1, 0, 3, 2),
}
EXPOSURE_MS = 20.0


def scenes(lighting: Lighting) -> Iterator[SceneImages]:
    for seed, name in enumerate(SYNTHETIC_30):
        rotate_deg = (0.0, 20.0, 45.0)[seed % 3]
        yield render_frame(synthetic_surface(name, seed, 512), lighting, 256, rotate_deg)
    for folder in bundled_materials().values():
        surface = load_material(folder)
        for rotate_deg in (0.0, 20.0):
            yield render_frame(surface, lighting, 256, rotate_deg, (rotate_deg, 11.0))


@pytest.mark.slow
@pytest.mark.parametrize("slant_deg", [30.0, 70.0])
def test_exchanged_lights_are_noticed_and_correct_ones_never_suspected(slant_deg: float) -> None:
    lighting = Lighting.ring(slant_deg)
    found: Counter[str] = Counter()
    for number, scene in enumerate(scenes(lighting)):
        sensor = SensorModel(bit_depth=(8, 12)[number % 2])
        rng = np.random.default_rng(number)
        light = np.concatenate([scene.lights + scene.ambient, scene.ambient[None]])
        *images, ambient = (sensor.expose(each * np.float32(EXPOSURE_MS), rng) for each in light)
        known = {"ambient": ambient, "full_scale": sensor.full_scale_dn}
        told = light_order(images, lighting, **known)
        found["sets"] += 1
        found["confirmed"] += told.is_confirmed
        found["suspected"] += told.is_refuted
        for name, order in EXCHANGED.items():
            told = light_order([images[light] for light in order], lighting, **known)
            found[name] += told.is_refuted
            found["exchanged and confirmed"] += told.is_confirmed
    sets = found.pop("sets")
    print(f"\nslant {slant_deg:g}, {sets} sets: share confirmed, suspected, noticed")
    for name in ("confirmed", "suspected", "exchanged and confirmed", *EXCHANGED):
        print(f"{name:26}{found[name] / sets:8.1%}")
    assert found["suspected"] == 0
    assert found["exchanged and confirmed"] == 0
    assert min(found[name] for name in ("confirmed", *EXCHANGED)) >= 0.9 * sets


@pytest.mark.slow
@pytest.mark.parametrize("error_deg", [3.0, 8.0])
def test_exchanged_lights_are_noticed_with_wrong_angles_and_levels(error_deg: float) -> None:
    rng = np.random.default_rng(3)
    configured, sensor = Lighting.ring(45.0), SensorModel()
    found: Counter[str] = Counter()
    for name in SYNTHETIC_30:
        tilts = configured.tilts_deg + rng.normal(0.0, error_deg, 4)
        slants = configured.slants_deg + rng.normal(0.0, error_deg, 4)
        actual = Lighting.from_angles(tuple(tilts), tuple(slants))
        scene = render_frame(synthetic_surface(name, 5, 512), actual, 192, 30.0)
        light = np.concatenate([scene.lights, 0.0 * scene.ambient[None]]) + scene.ambient
        light[:4] *= rng.uniform(0.8, 1.2, (4, 1, 1)).astype(np.float32)
        *images, ambient = (sensor.expose(each * np.float32(16.0), rng) for each in light)
        known = {"ambient": ambient, "full_scale": sensor.full_scale_dn}
        found["suspected"] += light_order(images, configured, **known).is_refuted
        for order in EXCHANGED.values():
            exchanged = [images[light] for light in order]
            found["noticed"] += light_order(exchanged, configured, **known).is_refuted
    assert found["suspected"] == 0
    assert found["noticed"] >= 0.97 * len(EXCHANGED) * len(SYNTHETIC_30)
