"""Errors of the solvers on rendered surfaces under near LEDs, beside those under distant ones.

``pytest tests/rig/test_near_truth.py -s`` prints the table; the slow tests measure more surfaces.
"""

import pytest

from classify import Lighting, Method, SurfaceEstimate, photometric_stereo
from classify.lights.near_light import sheet_of
from rig.scene.render import SceneImages, render_frame
from rig.scene.synthetic import synthetic_surface
from rig.simulation.sensor import SensorModel
from rig.simulation.simulated_set import SimulatedSet
from tests.angles import normal_errors_deg

SIDE, LOBE = 256, 1.0
RING = Lighting.ring(45.0)
SENSOR = SensorModel(bit_depth=12)


def error_deg(scene: SceneImages, surface: SurfaceEstimate) -> float:
    """Mean angular error of the pixels that all lights reach."""
    lit = ~scene.shadowed.any(axis=0) & surface.valid
    return float(normal_errors_deg(scene, surface)[lit].mean())


def errors_deg(name: str, fields: float, method: Method) -> dict[str, float]:
    """Mean errors of the ideal rig, and of a near one by what is known of its lights."""
    surface = synthetic_surface(name, 0, 2 * SIDE)
    near = Lighting.near(fields * SIDE * RING.directions)
    distant_scene = render_frame(surface, RING, SIDE)
    scene = render_frame(surface, RING, SIDE, led_distance_px=fields * SIDE, lobe_exponent=LOBE)
    ideal = SimulatedSet.expose(distant_scene, RING, SENSOR, seed=0)
    near_set = SimulatedSet.expose(scene, RING, SENSOR, seed=0)

    def solved(lighting: Lighting, **options: object) -> float:
        return error_deg(
            scene,
            photometric_stereo(
                near_set.images, lighting, method, ambient=near_set.ambient, noise=near_set.noise,
                full_scale=near_set.full_scale, **options,
            ),
        )  # fmt: skip

    return {
        "ideal rig": error_deg(distant_scene, ideal.solve(method)),
        "as distant": solved(RING),
        "positions": solved(near),
        "sheet": solved(RING, flat_field=sheet_of(near, (SIDE, SIDE), LOBE)),
        "positions and sheet": solved(near, flat_field=sheet_of(near, (SIDE, SIDE), LOBE)),
    }


@pytest.mark.parametrize(
    "name", ["rock", *(pytest.param(name, marks=pytest.mark.slow) for name in ("sand", "malv"))]
)
@pytest.mark.parametrize("method", ["ps4_robust", "ps4", "least_squares"])
@pytest.mark.parametrize(("fields", "beyond_ideal_deg"), [(5.0, 0.05), (2.0, 0.15)])
def test_a_near_rig_with_positions_and_a_sheet_is_as_good_as_a_distant_one(
    name: str, method: Method, fields: float, beyond_ideal_deg: float
) -> None:
    errors = errors_deg(name, fields, method)
    print(f"\n{name}, {fields:g} fields of view, {method}: ", errors)
    assert errors["positions and sheet"] < errors["ideal rig"] + beyond_ideal_deg
    assert errors["positions and sheet"] < errors["sheet"]
    assert errors["positions and sheet"] < errors["positions"] < errors["as distant"]
