"""What a calibration buys, against the known cost of single faults."""

from dataclasses import replace

import numpy as np
import pytest

from classify.calibration.calibration import CalibratedLights, Calibration, Response
from classify.calibration_benefit import remaining_errors
from classify.lighting import Lighting
from classify.lights.flat_field import FlatField

RING = Lighting.ring(45.0)
SHAPE = (96, 128)


def lights(lighting: Lighting, direction_error_deg: float = 0.0) -> CalibratedLights:
    near = lighting.positions_px is not None
    errors = np.full(len(lighting), direction_error_deg)
    return CalibratedLights(lighting, "plate", errors, np.zeros(4) if near else None, 0.0, None)


def flat_field(*levels: float) -> FlatField:
    logarithms = np.log(levels) - np.log(levels).mean()
    return FlatField(logarithms[:, None, None], np.stack([logarithms] * 2, axis=1))


def errors_deg(
    calibration: Calibration, configured: Lighting = RING, **options: float
) -> list[float]:
    return [degrees for _, degrees in remaining_errors(calibration, configured, SHAPE, **options)]


@pytest.mark.parametrize(
    ("calibration", "least_deg", "most_deg"),
    [
        (Calibration(lights=lights(RING)), 0.0, 0.02),
        # On a level part 0.05 / sin 45 cos 45 in one slope is 2.9 degrees.
        (Calibration(flat_field=flat_field(1.1, 1.0, 1.0, 1.0)), 2.0, 3.0),
        # In the table of single faults, 5 degrees cost 4.0 degrees at rms slope 0.45.
        (Calibration(lights=lights(Lighting.ring(50.0))), 2.0, 4.0),
    ],
    ids=["no fault", "an LED that is 10 % off", "a slant that is 5 degrees off"],
)
def test_a_single_fault_has_its_known_cost_and_is_removed(
    calibration: Calibration, least_deg: float, most_deg: float
) -> None:
    before, after = errors_deg(calibration)
    assert least_deg <= before < most_deg
    assert after < 0.02


def test_a_response_of_gamma_2_is_costly_and_is_removed() -> None:
    response = Response(np.linspace(0.0, 1.0, 257) ** 2.2, 0.0, linear=False)
    before, after = errors_deg(Calibration(response=response))
    assert before > 5.0
    assert after < 0.1
    assert len(errors_deg(Calibration(response=replace(response, linear=True)))) == 1


def test_near_lights_need_their_positions() -> None:
    """At two fields of view directions differ by 14 degrees over the frame."""
    near = Lighting.near(2.0 * max(SHAPE) * RING.directions)
    field = flat_field(1.0, 1.0, 1.0, 1.0)
    _, flat, after = errors_deg(Calibration(flat_field=field, lights=lights(near)))
    assert flat > 0.5
    assert after < 0.05


def test_positions_alone_help_as_well() -> None:
    near = Lighting.near(5.0 * max(SHAPE) * RING.directions)
    before, after = errors_deg(Calibration(lights=lights(near)))
    assert before > 3.0
    assert after < 0.2 * before


@pytest.mark.parametrize("error_deg", [0.3, 1.0, 3.0])
def test_errors_of_the_calibration_itself_remain(error_deg: float) -> None:
    *_, remaining = errors_deg(Calibration(lights=lights(RING, error_deg)))
    assert 0.3 * error_deg < remaining < 1.5 * error_deg


def test_an_uncertain_flat_field_remains() -> None:
    known = Calibration(flat_field=flat_field(1.0, 0.9, 1.1, 1.0))
    *_, remaining = errors_deg(known, flat_field_error=0.02)
    assert 0.3 < remaining < 2.0
