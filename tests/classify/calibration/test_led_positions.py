"""LED positions from rendered sheets: true errors against stated ones."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from classify.calibration.flat_field import PlateBlocks, fit_flat_field
from classify.calibration.led_positions import LedPositions, fit_led_positions
from classify.lighting import angles_between_deg
from tests.plates import Plate, ring_positions

Array = np.ndarray


def fitted(plate: Plate, turns: tuple[int, ...] = (0, 2)) -> LedPositions:
    stacks = [plate.turned(each).stack for each in turns]
    blocks = PlateBlocks.of(stacks, plate.full_scale)
    field = fit_flat_field(blocks)
    return fit_led_positions(field.ratios, field.weights, blocks.x, blocks.y)


def errors(found: LedPositions, plate: Plate) -> tuple[Array, Array]:
    """(N,) angles in degrees, and shares of the distance."""
    true, positions = np.asarray(plate.positions), found.positions
    lengths, distances = (np.linalg.norm(each, axis=1) for each in (true, positions))
    return angles_between_deg(positions, true), np.abs(distances / lengths - 1.0)


@st.composite
def irregular_lights(draw: st.DrawFn) -> Array:
    """Three to six LEDs on no ring: of any tilts, slants and distances."""
    count = draw(st.integers(3, 6))
    first = draw(st.floats(0.0, 360.0))
    apart = 360.0 / count
    positions = [
        ring_positions(
            draw(st.floats(4.0, 10.0)),
            draw(st.floats(30.0, 55.0)),
            [first + light * apart + draw(st.floats(-0.3, 0.3)) * apart],
        )
        for light in range(count)
    ]
    return np.concatenate(positions)


@settings(deadline=None, max_examples=8)
@given(
    positions=irregular_lights(),
    lobe=st.floats(0.0, 3.0),
    aim=st.sampled_from(["centre", "down"]),
    tilt=st.tuples(st.floats(-0.01, 0.01), st.floats(-0.01, 0.01)),
    specks=st.integers(0, 40),
    seed=st.integers(0, 999),
)
@pytest.mark.slow
def test_errors_are_within_three_times_those_stated(
    positions: Array, lobe: float, aim: str, tilt: tuple[float, float], specks: int, seed: int
) -> None:
    plate = Plate(
        positions, levels=(1.0, 0.95, 1.05, 0.9, 1.1, 1.0)[: len(positions)], lobe=lobe, aim=aim,
        tilt=tilt, specks=specks, seed=seed,
    )  # fmt: skip
    found = fitted(plate)
    angles_deg, shares = errors(found, plate)
    # Half a turn cancels the tilt to its square.
    assert (angles_deg < 3.0 * found.direction_errors_deg + 0.05).all()
    assert (shares < 3.0 * found.distance_errors + 1e-3).all()


@pytest.mark.parametrize(
    ("distance", "bits", "degrees", "share"),
    [(10.0, 12, 1.5, 0.03), (10.0, 8, 1.5, 0.03), (4.0, 12, 0.3, 0.005), (4.0, 8, 0.3, 0.005)],
)
def test_leds_at_five_and_two_fields_of_view(
    distance: float, bits: int, degrees: float, share: float
) -> None:
    plate = Plate(
        ring_positions(distance, [44.0, 47.0, 45.0, 43.0], [1.0, 92.0, 178.0, 271.0]),
        shape=(384, 512), bits=bits, noise=0.003 if bits == 12 else 0.01, specks=60,
        tilt=(0.01, -0.005),
    )  # fmt: skip
    found = fitted(plate)
    angles_deg, shares = errors(found, plate)
    assert angles_deg.max() < degrees
    assert shares.max() < share
    assert found.direction_errors_deg.max() < degrees
    assert found.aim == "centre"
    assert found.lobe_exponent == pytest.approx(1.0, abs=0.1)


def test_distant_lights_have_no_certain_positions() -> None:
    found = fitted(Plate(ring_positions(300.0)))
    assert max(found.direction_errors_deg.max(), 60.0 * found.distance_errors.max()) > 5.0
