"""Colours of maps: ends of scales, zero, and distinct colours for distinct values."""

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from capture import CapturedSet
from capture.maps import pictures
from capture.maps.pictures import ColourScale

RED, WHITE, BLUE = (178, 24, 43), (247, 247, 247), (33, 102, 172)


def test_signed_colours_are_blue_below_white_at_and_red_above_zero() -> None:
    values = np.array([[-2.0, -1.0, 0.0, 1.0, 2.0]], np.float32)
    scale = ColourScale(-1.0, 1.0, ColourScale.signed(values).colours)
    picture = scale.paint(values)
    assert picture.dtype == np.uint8
    np.testing.assert_allclose(picture[0], [BLUE, BLUE, WHITE, RED, RED], atol=1)


def test_a_few_outliers_do_not_change_the_colours_of_the_others() -> None:
    values = np.full((100, 100), 0.5, np.float32)
    values[0, :20] = -1000.0
    scale = ColourScale.signed(values)
    assert (scale.low, scale.high) == (-0.5, 0.5)


@settings(deadline=None)
@given(st.floats(0, 1e6), st.floats(1e-6, 1e6))
def test_grey_runs_from_black_at_zero_to_white_at_the_top(value: float, top: float) -> None:
    picture = pictures.grey(np.full((1, 1), value, np.float32), top)
    assert picture.shape == (1, 1, 3)
    assert abs(float(picture[0, 0, 0]) - 255 * min(value / top, 1.0)) <= 0.51


@pytest.mark.parametrize("dtype", [np.bool_, np.uint8, np.uint16, np.float32])
def test_a_uniform_map_has_a_uniform_picture(dtype: Any) -> None:
    for value in (0, 1):
        picture = pictures.grey(np.full((5, 6), value, dtype), top=1.0)
        assert picture.shape == (5, 6, 3)
        assert (picture == 255 * value).all()
    assert (ColourScale.signed(np.zeros((3, 4), np.float32)).paint(np.zeros((3, 4))) >= 246).all()


def test_large_maps_are_averaged_and_small_ones_are_unchanged() -> None:
    small = np.zeros((30, 512), np.float32)
    assert pictures.reduced(small) is small
    x = np.arange(2048, dtype=np.float32)
    reduced = pictures.reduced(np.tile(x, (4, 1)))
    assert reduced.shape == (1, 512)
    np.testing.assert_allclose(reduced[0], x.reshape(-1, 4).mean(axis=1))
    assert pictures.reduced(np.zeros((3, 4000, 3), np.float32)).shape[1:] == (512, 3)


def test_a_reduced_pixel_is_the_mean_of_what_is_known_if_half_of_it_is() -> None:
    values = np.tile(np.array([1.0, 1.0, 3.0, np.nan], np.float32), (2, 512))
    values[:, :4] = np.nan
    reduced = pictures.reduced(values, longest_px=1024)
    np.testing.assert_allclose(reduced[0, :4], [np.nan, np.nan, 1.0, 3.0])
    colours = ColourScale.grey(reduced).paint(reduced)
    assert colours[0, :2].tolist() == [[200] * 3] * 2
    assert colours[0, 3].tolist() == [255] * 3


def test_reducing_a_map_of_labels_keeps_its_values() -> None:
    labels = np.random.default_rng(0).choice(np.array([0, 3, 255], np.uint8), (900, 1100))
    thinned = pictures.reduced(labels, cv2.INTER_NEAREST)
    assert thinned.shape == (419, 512)
    assert set(np.unique(thinned)) == {0, 3, 255}


def test_scales_of_maps_of_zeros_have_limits() -> None:
    values = np.zeros((50, 50), np.float32)
    assert (ColourScale.signed(values).low, ColourScale.grey(values).high) == (-1.0, 1.0)
    values[0, 0] = -3.0
    assert ColourScale.signed(values).high == 3.0


@pytest.mark.parametrize("lights", [1, 4, 8, 255, 300])
def test_each_dropped_light_has_its_own_colour(lights: int) -> None:
    colours = pictures.dropped_colours(lights)
    assert colours.shape == (256, 3)
    assert colours[255].tolist() == [235, 235, 235]
    if lights <= 8:
        assert len(np.unique(colours[[*range(lights), 255]], axis=0)) == lights + 1


def test_maps_of_few_values_show_each_value_in_its_colour(
    made_set: Callable[..., CapturedSet],
) -> None:
    images = np.full((4, 1, 6), 1000, np.uint16)
    for column in range(1, 5):
        images[:column, 0, column] = 0
    surface = made_set(images).solve("least_squares")
    # Nothing is predicted where all lights are out.
    assert surface.shadow_count[0, [0, 1, 4, 5]].tolist() == [0, 1, 0, 0]
    colours = pictures.shadow_colours(4)
    for lights in (3, 4, 8, 50):
        shown = pictures.shadow_colours(lights)[: lights + 1]
        assert len(np.unique(shown, axis=0)) == lights + 1
    np.testing.assert_array_equal(
        pictures.coloured(surface.shadow_count, colours), colours[surface.shadow_count]
    )
