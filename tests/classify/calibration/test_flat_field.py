"""Flat field of rendered sheets: errors, what is left out, and degree."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from classify.calibration.flat_field import FittedFlatField, PlateBlocks, fit_flat_field
from tests.plates import Plate, ring_positions

Array = np.ndarray


def fitted(
    plate: Plate, turns: tuple[int, ...] = (0, 2), mask: Array | None = None
) -> FittedFlatField:
    stacks = [plate.turned(each).stack for each in turns]
    return fit_flat_field(PlateBlocks.of(stacks, plate.full_scale, mask))


def errors(found: FittedFlatField, plate: Plate) -> Array:
    """(N, H, W) log ratio of the flat field to the light on a level sheet."""
    rows, columns = plate.shape
    strengths = found.flat_field.strengths(np.arange(rows), np.arange(columns), plate.shape)
    difference = np.log(strengths / plate.strengths)
    return difference - difference.mean()


@settings(deadline=None, max_examples=10)
@given(
    distance=st.floats(4.0, 40.0),
    slant_deg=st.floats(25.0, 60.0),
    lobe=st.floats(0.0, 3.0),
    vignetting=st.floats(0.0, 0.4),
    tilt=st.tuples(st.floats(-0.02, 0.02), st.floats(-0.02, 0.02)),
    specks=st.integers(0, 60),
    shape=st.sampled_from([(192, 192), (144, 224)]),
)
def test_the_error_is_below_3_in_1000_with_noise_grain_dust_and_tilt(
    distance: float, slant_deg: float, lobe: float, vignetting: float,
    tilt: tuple[float, float], specks: int, shape: tuple[int, int],
) -> None:  # fmt: skip
    plate = Plate(
        ring_positions(distance, slant_deg), lobe=lobe, vignetting=vignetting, tilt=tilt,
        specks=specks, shape=shape,
    )  # fmt: skip
    found = fitted(plate)
    difference = errors(found, plate)
    assert difference.std() < 0.003
    assert difference.std() < 3.0 * max(found.error, 2e-4)


def test_degree_6_serves_leds_at_one_and_a_half_fields_of_view() -> None:
    plate = Plate(ring_positions(3.0), grain=0.005)
    found = fitted(plate)
    assert max(found.degree) == 6
    assert errors(found, plate).std() < 0.003
    assert max(fitted(Plate(ring_positions(30.0), vignetting=0.0)).degree) == 2


def test_half_a_turn_cancels_tilt_and_uneven_reflectance() -> None:
    plate = Plate(ring_positions(10.0), tilt=(0.04, 0.02), waviness=0.01)
    ratios = [errors(fitted(plate, turns), plate) for turns in ((0,), (0, 2))]
    once, twice = ((each - each.mean(axis=0)).std() for each in ratios)
    assert once > 0.02
    assert twice < 0.001
    assert ratios[1].std() < 0.4 * ratios[0].std()


def test_offsets_are_those_of_the_tilt() -> None:
    plate = Plate(ring_positions(10.0), tilt=(0.03, 0.0))
    offsets = fitted(plate).offsets
    # Light 0 stands at tilt 0 and slant 45: 1 - p tan(45), and the other way after half a turn.
    np.testing.assert_allclose(offsets[:, 0] - offsets[:, 2], [-0.06, 0.06], atol=0.002)


def test_only_the_flat_areas_of_a_masked_part_count() -> None:
    plate = Plate(ring_positions(8.0), grain=0.01)
    stack = plate.stack
    x, _ = plate.coordinates()
    groove = np.abs(x + 0.3) < 0.15
    stack.images[0, groove] //= 2
    blocks = PlateBlocks.of([stack], plate.full_scale, ~groove)
    assert errors(fit_flat_field(blocks), plate).std() < 0.003
    # Without a mask, blocks of the groove do not fit and are not used.
    unmasked = fit_flat_field(PlateBlocks.of([stack], plate.full_scale))
    assert unmasked.unused == pytest.approx(0.15, abs=0.06)
    assert errors(unmasked, plate).std() < 0.003
