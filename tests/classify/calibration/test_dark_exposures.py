"""A dark part of several exposures."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from classify.base.errors import InputError
from classify.calibration.calibration import Calibration
from classify.calibration.dark import Dark
from classify.images import ImageStack

FULL = 4095.0


def dark(exposure_ms: float | None, *hot: tuple[int, int], full: float = FULL) -> Dark:
    """A camera of offset 60 and 3 dn/ms of dark current, whose variance is 4 + 0.5 / ms."""
    time_ms = exposure_ms or 0.0
    places = np.array(hot, np.int32).reshape(-1, 2)
    noise = (4.0 + 0.5 * time_ms) ** 0.5
    return Dark(60.0 + 3.0 * time_ms, noise, places, 0.2 * time_ms, full, exposure_ms)


@given(st.permutations([5.0, 10.0, 40.0]), st.floats(5.0, 40.0))
def test_offset_and_variance_are_interpolated(order: list[float], exposure_ms: float) -> None:
    several = dark(order[0]).with_exposure_of(dark(order[1])).with_exposure_of(dark(order[2]))
    assert several.exposures_ms == (5.0, 10.0, 40.0)
    found, true = several.at(exposure_ms), dark(exposure_ms)
    # An exposure within 2 % of a measured one has its values.
    assert found.offset == pytest.approx(true.offset, rel=0.02)
    assert found.noise == pytest.approx(true.noise, rel=0.01)
    assert found.ambient == pytest.approx(true.ambient, rel=0.02)
    assert found.longer is None


def test_a_pixel_is_hot_if_it_is_at_one_of_the_exposures_around() -> None:
    several = (
        dark(5.0, (1, 1))
        .with_exposure_of(dark(10.0, (1, 1), (2, 3)))
        .with_exposure_of(dark(40.0, (7, 7)))
    )
    assert several.at(7.0).hot_pixels.tolist() == [[1, 1], [2, 3]]
    assert several.at(5.05).hot_pixels.tolist() == [[1, 1]]


@pytest.mark.parametrize("exposure_ms", [4.8, 41.0, None])
def test_no_exposure_is_extrapolated(exposure_ms: float | None) -> None:
    several = dark(5.0).with_exposure_of(dark(40.0))
    assert not several.holds_at(exposure_ms)
    with pytest.raises(InputError, match="measured from 5 to 40 ms"):
        several.at(exposure_ms)


def test_one_exposure_holds_there_and_where_none_is_stated() -> None:
    one = dark(20.0)
    assert [one.holds_at(each) for each in (20.3, 21.0, None)] == [True, False, True]
    assert dark(None).holds_at(3.0)
    with pytest.raises(InputError, match=r"20 ms only, not at 21 ms"):
        Calibration(one).at(21.0)


def test_an_equal_exposure_is_replaced() -> None:
    again = Dark(9.0, 1.0, np.empty((0, 2), np.int32), None, FULL, 20.1)
    assert dark(5.0).with_exposure_of(dark(20.0)).with_exposure_of(again).exposures_ms == (
        5.0,
        20.1,
    )


@pytest.mark.parametrize(
    ("first", "second"), [(20.0, 10.0), (20.0, 20.0), (None, 10.0), (20.0, None)]
)
def test_exposures_rise(first: float | None, second: float | None) -> None:
    values = (1.0, 1.0, np.empty((0, 2), np.int32), None, FULL)
    with pytest.raises(InputError, match="rising"):
        Dark(*values, first, dark(second))


def test_exposures_have_one_depth() -> None:
    with pytest.raises(InputError, match="one depth"):
        dark(5.0).with_exposure_of(dark(10.0, full=255.0))


def test_a_dark_part_that_does_not_hold_is_left_out_where_it_may_be() -> None:
    assert Calibration(dark(20.0)).holding_at(10.0).dark is None
    assert Calibration(dark(20.0)).holding_at(20.0).dark is not None


def test_images_are_never_corrected_by_another_exposure() -> None:
    several = Calibration(dark(5.0).with_exposure_of(dark(40.0)))
    stack = ImageStack(np.full((1, 16, 16), 500, np.uint16), None)
    with pytest.raises(ValueError, match="several exposures"):
        several.corrected(stack, FULL)
    assert several.at(20.0).corrected(stack, FULL).images == pytest.approx(
        500.0 - 120.0 * FULL / FULL, rel=0.06
    )
