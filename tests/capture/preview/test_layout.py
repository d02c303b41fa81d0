"""Images on the page stand as the lights stand around the part."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from capture.session.preview_loop import Places, places_of
from classify import Lighting


def ring(*tilts_deg: float) -> Places | None:
    return places_of(Lighting.ring(45.0, tilts_deg).directions)


def test_four_lights_are_a_cross_around_the_part() -> None:
    places = ring(0.0, 90.0, 180.0, 270.0)
    assert places is not None
    third = pytest.approx(1.0 / 3.0, abs=1e-3)
    east, north, west, south = places.lights
    assert places.size == third
    assert (*places.part,) == (third, third)
    assert east == (pytest.approx(2.0 / 3.0, abs=1e-3), third)
    assert north == (third, 0.0)
    assert west == (0.0, third)
    assert south == (third, pytest.approx(2.0 / 3.0, abs=1e-3))


def test_exchanged_leds_are_exchanged_on_the_page() -> None:
    straight, crossed = ring(0.0, 90.0, 180.0, 270.0), ring(90.0, 0.0, 180.0, 270.0)
    assert straight is not None
    assert crossed is not None
    assert crossed.lights[:2] == straight.lights[1::-1]


@given(
    st.lists(st.integers(0, 35), min_size=3, max_size=8, unique=True),
    st.floats(20.0, 70.0),
)
def test_images_stand_by_tilt_and_do_not_overlap(steps: list[int], slant_deg: float) -> None:
    directions = Lighting.ring(slant_deg, [10.0 * step for step in steps]).directions
    places = places_of(directions)
    if places is None:
        return
    corners = np.array([*places.lights, places.part])
    assert (corners > -1e-3).all()
    assert (corners + places.size < 1.0 + 1e-3).all()
    for one, other in combinations(corners, 2):
        assert np.abs(one - other).max() > places.size - 1e-3
    # From the part to each image is the tilt of its light, y up.
    away = corners[:-1] - corners[-1]
    for (x, y), step in zip(away, steps, strict=True):
        off_deg = np.degrees(np.arctan2(-y, x)) - 10.0 * step
        assert abs((off_deg + 180.0) % 360.0 - 180.0) < 0.5


@pytest.mark.parametrize("count", [3, 4, 5, 6, 8])
def test_even_rings_have_places(count: int) -> None:
    assert ring(*(360.0 * light / count for light in range(count))) is not None


def test_a_dome_of_many_lights_and_a_light_above_the_part_have_rows() -> None:
    assert ring(*(5.0 * light for light in range(72))) is None
    above = np.array([[0.0, 0.0, 1.0], *Lighting.ring(45.0).directions])
    assert places_of(above) is None
