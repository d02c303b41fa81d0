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
from rig.simulation.simulated_set import SimulatedSet

EXCHANGED = {
    "opposite pair 0, 2": (2, 1, 0, 3),
    "opposite pair 1, 3": (0, 3, 2, 1),
    "neighbours 0, 1": (1, 0, 2, 3),
    "neighbours 1, 2": (0, 2, 1, 3),
    "all by one place": (1, 2, 3, 0),
    "neighbours 0, 1 and 2, 3": (1, 0, 3, 2),
}


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
        image_set = SimulatedSet.expose(scene, lighting, sensor, seed=number)
        known = {"ambient": image_set.ambient, "full_scale": image_set.full_scale}
        told = light_order(image_set.images, lighting, **known)
        found["sets"] += 1
        found["confirmed"] += told.is_confirmed
        found["suspected"] += told.is_refuted
        for name, order in EXCHANGED.items():
            told = light_order(image_set.images[list(order)], lighting, **known)
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
    configured = Lighting.ring(45.0)
    found: Counter[str] = Counter()
    for name in SYNTHETIC_30:
        tilts = configured.tilts_deg + rng.normal(0.0, error_deg, 4)
        slants = configured.slants_deg + rng.normal(0.0, error_deg, 4)
        actual = Lighting.from_angles(tuple(tilts), tuple(slants))
        scene = render_frame(synthetic_surface(name, 5, 512), actual, 192, 30.0)
        levels = rng.uniform(0.8, 1.2, 4)
        image_set = SimulatedSet.expose(
            scene, actual, SensorModel(), seed=0, exposure_ms=16.0, led_levels=levels
        )
        known = {"ambient": image_set.ambient, "full_scale": image_set.full_scale}
        found["suspected"] += light_order(image_set.images, configured, **known).is_refuted
        for order in EXCHANGED.values():
            exchanged = image_set.images[list(order)]
            found["noticed"] += light_order(exchanged, configured, **known).is_refuted
    assert found["suspected"] == 0
    assert found["noticed"] >= 0.97 * len(EXCHANGED) * len(SYNTHETIC_30)
