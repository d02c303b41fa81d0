"""Least level of an LED by brightness, where the images do not show the levels."""

import numpy as np
import pytest

from capture.station.judge.judge import STOP_LED_LEVEL
from capture.station.judge.teaching.teaching_limits import least_led_level
from rig.acceptance import WEAK_LED_SHARE

MEANS = (0.2, 0.21, 0.19, 0.2)


def signals_with(spread: float, parts: int = 25) -> list[tuple[float, ...]]:
    rng = np.random.default_rng(1)
    return [tuple(np.multiply(MEANS, rng.normal(1.0, spread, 4)).tolist()) for _ in range(parts)]


def test_parts_of_equal_brightness_keep_the_common_limit() -> None:
    assert least_led_level(signals_with(0.01), MEANS) == STOP_LED_LEVEL


def test_parts_of_varied_brightness_lower_it() -> None:
    signals = signals_with(0.06)
    least = least_led_level(signals, MEANS)
    lowest = min(min(np.divide(part, MEANS)) / max(np.divide(part, MEANS)) for part in signals)
    assert WEAK_LED_SHARE < least < min(lowest, STOP_LED_LEVEL)


@pytest.mark.parametrize("parts", [0, 1])
def test_parts_with_known_levels_keep_the_common_limit(parts: int) -> None:
    assert least_led_level(signals_with(0.2, parts), MEANS) == STOP_LED_LEVEL


def test_no_level_is_below_that_of_a_weak_led() -> None:
    black = [(0.0, 0.2, 0.2, 0.2), (0.0, 0.0, 0.0, 0.0)]
    assert least_led_level(black, MEANS) == WEAK_LED_SHARE
