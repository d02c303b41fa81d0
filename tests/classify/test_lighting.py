"""Axes, tilt, slant and their signs."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from classify import InputError, Lighting
from classify.lighting import angles_between_deg, light_vectors, orientation_near, orientation_text

degrees = st.floats(0.0, 360.0, exclude_max=True)
slants = st.floats(0.5, 89.0)


@pytest.mark.parametrize(
    ("tilt_deg", "slant_deg", "towards"),
    [
        (0, 45, (1, 0, 1)),
        (90, 45, (0, 1, 1)),
        (180, 45, (-1, 0, 1)),
        (270, 45, (0, -1, 1)),
        (0, 0, (0, 0, 1)),
        (0, 60, (np.sqrt(3), 0, 1)),
    ],
)
def test_tilt_runs_anticlockwise_from_x_and_slant_from_the_axis(
    tilt_deg: float, slant_deg: float, towards: tuple
) -> None:
    expected = np.array(towards) / np.linalg.norm(towards)
    np.testing.assert_allclose(light_vectors(tilt_deg, slant_deg), expected, atol=1e-15)


def test_ring_has_the_four_tilts_of_ps4_in_order() -> None:
    ring = Lighting.ring(slant_deg=30.0)
    assert ring.tilts_deg.tolist() == [0.0, 90.0, 180.0, 270.0]
    assert ring.slants_deg.tolist() == [30.0] * 4
    assert ring.intensities.tolist() == [1.0] * 4
    assert not ring.intensities_given
    assert Lighting(ring.directions, np.ones(4)).intensities_given
    assert len(ring) == 4
    assert Lighting.ring(40.0, tilts_deg=[0, 120, 240]).tilts_deg.tolist() == [0.0, 120.0, 240.0]


@given(st.lists(st.tuples(degrees, slants), min_size=1, max_size=9))
def test_angles_come_back_from_directions(angles: list[tuple[float, float]]) -> None:
    tilts, slant = np.array(angles).T
    lighting = Lighting.from_angles(tilts, slant)
    np.testing.assert_allclose(np.linalg.norm(lighting.directions, axis=1), 1.0)
    np.testing.assert_allclose(lighting.slants_deg, slant, atol=1e-8)
    apart = (lighting.tilts_deg - tilts + 180.0) % 360.0 - 180.0
    np.testing.assert_allclose(apart, 0.0, atol=1e-7)
    assert ((lighting.tilts_deg >= 0) & (lighting.tilts_deg < 360)).all()
    again = Lighting.from_angles(lighting.tilts_deg, lighting.slants_deg)
    np.testing.assert_allclose(again.directions, lighting.directions, atol=1e-10)


@given(st.floats(0.01, 1e6), degrees, slants)
def test_length_of_a_direction_does_not_matter(length: float, tilt: float, slant: float) -> None:
    direction = light_vectors([tilt], [slant])
    np.testing.assert_allclose(Lighting(length * direction).directions, direction, atol=1e-12)


def test_lights_of_equal_directions_and_intensities_are_equal() -> None:
    ring = Lighting.ring(45.0)
    assert ring not in (Lighting.ring(44.0), Lighting(ring.directions, [1, 1, 1, 2]), "ring")
    lighting = Lighting(np.array([[0.0, 1.0, 1.0], [1.0, 0.0, 1.0]]))
    same = Lighting(np.array([[-0.0, 2.0, 2.0], [4.0, -0.0, 4.0]]))
    assert same == lighting
    assert hash(same) == hash(lighting)
    assert len({lighting, same, ring, Lighting.ring(45.0), Lighting.ring(40.0)}) == 3


@given(st.lists(st.tuples(degrees, slants, st.floats(2.0, 1e6)), min_size=1, max_size=9))
def test_near_lights_have_the_directions_of_their_positions(
    lights: list[tuple[float, float, float]],
) -> None:
    tilts, slant, distances = np.array(lights).T
    distant = Lighting.from_angles(tilts, slant)
    near = Lighting.near(distances[:, None] * distant.directions)
    np.testing.assert_allclose(near.directions, distant.directions, atol=1e-12)
    assert near.positions_px is not None
    np.testing.assert_allclose(np.linalg.norm(near.positions_px, axis=1), distances)
    assert near.within(1e-3, distant)
    assert not near.intensities_given
    brighter = replace(near, intensities=np.full(len(near), 2.0))
    assert np.array_equal(brighter.positions_px, near.positions_px)
    assert brighter == Lighting.near(near.positions_px, brighter.intensities)
    assert hash(near) == hash(Lighting.near(near.positions_px))
    assert near not in (distant, brighter, Lighting.near(2.0 * near.positions_px))


def test_directions_other_than_those_of_the_positions_are_an_error() -> None:
    near = Lighting.near(500.0 * Lighting.ring(45.0).directions)
    with pytest.raises(InputError, match="disagree"):
        replace(near, directions=Lighting.ring(40.0).directions)
    with pytest.raises(InputError, match=r"shape \(3, 3\) for 4 lights"):
        replace(near, positions_px=near.positions_px[:3])


def test_lighting_cannot_be_changed_and_keeps_a_copy() -> None:
    directions = Lighting.ring().directions.copy()
    lighting = Lighting(directions)
    directions[0] = 9.0
    assert lighting == Lighting.ring()
    with pytest.raises(ValueError, match="read-only"):
        lighting.directions[0, 0] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        lighting.intensities[0] = 2.0


RING = Lighting.ring().directions


@pytest.mark.parametrize(
    ("make", "given", "cause"),
    [
        (Lighting, (np.empty((0, 3)),), "row"),
        (Lighting, ([[0, 0, 0]],), "zero or not finite"),
        (Lighting, ([[0, np.nan, 1]],), "zero or not finite"),
        (Lighting, ([[1e300, 0, 1e300]],), "beyond 1e9"),
        (Lighting, ([["a", "b", "c"]],), "numbers"),
        (Lighting, ([[0, 0, 1], [0, 1]],), "numbers"),
        (Lighting, ([[0, 0, 1], [1, 0, 0]],), "light 1 .*horizon"),
        (Lighting, (RING, [1, 1, 1]), "3 light intensities for 4 lights"),
        *((Lighting, (RING, [1, 1, 1, bad]), "positive") for bad in (0, np.nan, 1e300)),
        (Lighting, (RING, [1, 1, 1, "bright"]), "numbers"),
        (Lighting.near, ([[3.0, 4.0]],), "shape"),
        (Lighting.near, ([[300.0, 0.0, np.nan]],), "not finite"),
        (Lighting.near, ([[0.1, 0.0, 0.2]],), "0.223607 px"),
        (Lighting.near, ([[300.0, 0.0, -400.0]],), "horizon"),
        (Lighting.near, ([["far", 0.0, 1.0]],), "numbers"),
        *((Lighting.from_angles, ([0, 90], bad), "slant") for bad in (-1.0, 90.0, 120.0, np.nan)),
        *((Lighting.from_angles, ([0, bad], 45), "tilts") for bad in (np.nan, np.inf, "north")),
        (Lighting.from_angles, ([0, 90, 180, 270], [45, 50]), "2 slants for 4 tilts"),
    ],
)
def test_unusable_lights_are_named(make: Callable, given: tuple, cause: str) -> None:
    with pytest.raises(InputError, match=cause):
        make(*given)


@given(degrees, st.floats(-29.0, 29.0))
def test_the_nearest_light_is_found_across_tilt_0(tilt: float, off: float) -> None:
    lighting = Lighting.from_angles([(tilt + off) % 360.0, (tilt + 180.0) % 360.0], 40.0)
    assert lighting.light_nearest_tilt(tilt) == 0
    assert lighting.light_nearest_tilt(tilt - 360.0) == 0
    assert lighting.light_nearest_tilt(tilt + 180.0) == 1


def test_the_error_without_a_near_light_names_all_tilts() -> None:
    with pytest.raises(InputError, match=r"tilt 45; .* 0, 90, 180, 270"):
        Lighting.ring().light_nearest_tilt(45.0)
    assert Lighting.ring().light_nearest_tilt(44.0, within_deg=45.0) == 0


@given(degrees, st.floats(1.0, 80.0), st.floats(0.05, 5.0), st.floats(0.0, 20.0))
def test_lights_are_within_the_largest_angle_between_them(
    tilt: float, slant: float, apart: float, tolerance: float
) -> None:
    """At one tilt the angle between directions is the difference of their slants."""
    one = Lighting.from_angles([tilt, tilt + 90.0], [slant, 40.0])
    other = Lighting.from_angles([tilt, tilt + 90.0], [slant + apart, 40.0])
    if abs(apart - tolerance) > 1e-6:
        assert one.within(tolerance, other) == other.within(tolerance, one) == (apart < tolerance)
    assert one.within(1e-5, one)


@given(degrees, st.floats(0.0, 70.0), st.floats(1e-4, 100.0), st.floats(1e-3, 1e6))
def test_the_angle_between_vectors_of_any_length_is_found(
    tilt: float, slant: float, apart: float, length: float
) -> None:
    one, other = (light_vectors(tilt, [[each]]) for each in (slant, slant + apart))
    found = angles_between_deg(length * one, other)
    assert found.shape == (1, 1)
    assert found[0, 0] == pytest.approx(apart, rel=1e-6, abs=1e-9)


def test_lights_of_another_number_or_order_are_not_within_an_angle() -> None:
    ring = Lighting.ring(45.0)
    assert not ring.within(10.0, Lighting.ring(45.0, (90, 180, 270, 0)))  # in another order
    assert not ring.within(180.0, Lighting.ring(45.0, (0, 90, 180)))
    assert not Lighting.ring(45.0, (0, 90, 180)).within(180.0, ring)
    assert ring.within(1e-5, Lighting(2.0 * ring.directions, np.array([1, 2, 3, 4.0])))


@pytest.mark.parametrize(
    ("orientation_deg", "near_deg", "folded_deg"),
    [
        (179.6, 0.0, -0.4), (0.2, 180.0, 180.2), (10.0, 370.0, 370.0), (45.0, -150.0, -135.0),
        (100.0, 10.0, -80.0), (30.0, 20.0, 30.0),
    ],
)  # fmt: skip
def test_an_orientation_is_folded_towards_another(
    orientation_deg: float, near_deg: float, folded_deg: float
) -> None:
    assert orientation_near(orientation_deg, near_deg) == pytest.approx(folded_deg)


@pytest.mark.parametrize(
    ("orientation_deg", "period_deg", "text"),
    [(179.94, 180.0, "179.9"), (179.98, 180.0, "0.0"), (0.0, 180.0, "0.0"), (359.96, 360.0, "0.0")],
)
def test_the_text_of_an_orientation_is_below_its_period(
    orientation_deg: float, period_deg: float, text: str
) -> None:
    assert orientation_text(orientation_deg, 1, period_deg) == text
