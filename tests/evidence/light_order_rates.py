"""Rates at which exchanged lights are noticed, and correct ones suspected.

    python -m tests.evidence.light_order_rates [--quick]

A table for each slant of the lights, and a line for lights at wrong angles and levels. --quick
takes every third scene.
"""

import argparse
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import islice

import numpy as np

from classify import Lighting
from classify.lights.order import light_order
from rig.scene.material_folder import bundled_materials, load_material
from rig.scene.render import SceneImages, render_frame
from rig.scene.synthetic import SYNTHETIC_30, synthetic_surface
from rig.simulation.sensor import SensorModel
from rig.simulation.simulated_set import SimulatedSet

from .limits import at_least, at_most

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


def _exchanged_are_noticed(slant_deg: float, step: int) -> bool:
    lighting = Lighting.ring(slant_deg)
    found: Counter[str] = Counter()
    for number, scene in islice(enumerate(scenes(lighting)), 0, None, step):
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
    are_met = [
        at_most("suspected", found["suspected"], 0),
        at_most("exchanged and confirmed", found["exchanged and confirmed"], 0),
        *(at_least(name, found[name] / sets, 0.9) for name in ("confirmed", *EXCHANGED)),
    ]
    return all(are_met)


def _wrong_angles_do_not_matter(error_deg: float, step: int) -> bool:
    rng = np.random.default_rng(3)
    configured = Lighting.ring(45.0)
    found: Counter[str] = Counter()
    names = SYNTHETIC_30[::step]
    for name in names:
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
    print(f"\nangles off by {error_deg:g} degrees, levels by 20 %")
    are_met = [
        at_most("suspected", found["suspected"], 0),
        at_least("noticed", found["noticed"] / len(EXCHANGED) / len(names), 0.97),
    ]
    return all(are_met)


def main(arguments: Sequence[str]) -> int:
    """Print the tables; return 1 if a rate is beyond its limit."""
    parser = argparse.ArgumentParser(prog="light_order_rates")
    parser.add_argument("--quick", action="store_true")
    step = 3 if parser.parse_args(arguments).quick else 1
    are_met = [
        *(_exchanged_are_noticed(slant_deg, step) for slant_deg in (30.0, 70.0)),
        *(_wrong_angles_do_not_matter(error_deg, step) for error_deg in (3.0, 8.0)),
    ]
    return int(not all(are_met))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
