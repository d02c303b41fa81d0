"""The response of cameras with known curves, and ladders that have none."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from classify.base.errors import CalibrationRejected, InputError
from classify.calibration.exposure_ladder import response_of

from .simulated_ladder import EXPOSURES_MS, FULL, Curve, gamma, ladder, srgb

LEVELS = np.linspace(0.0, 1.0, 257)
# Asked for, as a share of full scale.
WITHIN = 0.005


def light_at_levels(curve: Curve) -> np.ndarray:
    light = np.linspace(0.0, 1.0, 10_001)
    return np.interp(LEVELS, curve(light), light)


def error_of(curve: Curve, **scene: float) -> float:
    found = response_of(ladder(curve, **scene), EXPOSURES_MS, FULL)
    assert not found.response.linear
    measured = found.lowest <= FULL * LEVELS
    return float(np.abs(found.response.curve - light_at_levels(curve))[measured].max())


def error_up_to_a_line(curve: Curve, **scene: float) -> float:
    """Error of differences of light: the images show no others."""
    found = response_of(ladder(curve, **scene), EXPOSURES_MS, FULL)
    measured = (found.lowest <= FULL * LEVELS) & (found.highest >= FULL * LEVELS)
    true, fitted = light_at_levels(curve)[measured], found.response.curve[measured]
    line = np.polyval(np.polyfit(fitted, true, 1), fitted)
    return float(np.abs(line - true).max())


@settings(max_examples=25)
@given(st.floats(1.2, 3.0), st.sampled_from([0.0, 1 / 64]), st.floats(0.01, 0.6))
def test_a_gamma_curve_is_found(exponent: float, black: float, fall_off: float) -> None:
    assert error_of(gamma(exponent), black=black, fall_off=fall_off) < WITHIN


@settings(max_examples=25)
@given(st.sampled_from([0.0, 1 / 64]), st.floats(0.01, 0.6))
def test_the_srgb_curve_is_found(black: float, fall_off: float) -> None:
    assert error_of(srgb, black=black, fall_off=fall_off) < WITHIN


@settings(max_examples=25)
@given(st.floats(-0.6, 0.4), st.floats(0.0, 1.0), st.floats(0.01, 0.6))
def test_differences_of_light_follow_any_smooth_rising_curve(
    bend: float, middle: float, fall_off: float
) -> None:
    def curve(light: np.ndarray) -> np.ndarray:
        return light + bend * light * (1.0 - light) * (1.0 - 0.8 * (1.0 - 2.0 * middle) * light)

    assert error_up_to_a_line(curve, fall_off=fall_off) < WITHIN


@settings(max_examples=25)
@given(st.floats(2.0, 8.0), st.sampled_from([0.0, 1 / 64]), st.floats(0.01, 0.6))
def test_the_curves_of_picture_styles_are_found(
    contrast: float, black: float, fall_off: float
) -> None:
    # sRGB with more contrast, which has a toe and a shoulder.
    def curve(light: np.ndarray) -> np.ndarray:
        low, high = 1 / (1 + np.exp(contrast / 2)), 1 / (1 + np.exp(-contrast / 2))
        return (1 / (1 + np.exp(contrast * (0.5 - srgb(light)))) - low) / (high - low)

    assert error_up_to_a_line(curve, black=black, fall_off=fall_off) < WITHIN


@settings(max_examples=25)
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 1 / 64]), st.floats(0.01, 0.6))
def test_a_linear_camera_is_said_to_be_linear(seed: int, black: float, fall_off: float) -> None:
    values = ladder(lambda light: light, fall_off, black, seed=seed)
    found = response_of(values, EXPOSURES_MS, FULL)
    assert found.response.linear
    assert found.departure < 0.001
    assert found.offset == pytest.approx(FULL * black, abs=0.1)
    np.testing.assert_array_equal(found.response.curve, LEVELS)


@pytest.mark.parametrize("black", [0.0, 1 / 64])
def test_the_offset_of_a_gamma_camera_is_found(black: float) -> None:
    found = response_of(ladder(gamma(2.2), black=black), EXPOSURES_MS, FULL)
    assert found.offset == pytest.approx(FULL * black ** (1 / 2.2), abs=3.0)


@pytest.mark.parametrize("curve", [lambda light: light, gamma(2.2)])
@pytest.mark.parametrize("fall_off", [0.01, 0.1, 0.4])
@pytest.mark.parametrize("wrong", [5, 8, 12])
def test_one_exposure_that_the_camera_does_not_keep_is_named(
    curve: Curve, fall_off: float, wrong: int
) -> None:
    said_ms = EXPOSURES_MS.copy()
    said_ms[wrong] *= 1.1
    with pytest.raises(CalibrationRejected, match=f"exposure of {said_ms[wrong]:g} ms acts as"):
        response_of(ladder(curve, fall_off), said_ms, FULL)


def test_automatic_exposure_is_refused() -> None:
    values = np.full((len(EXPOSURES_MS), 8), 150.0)
    with pytest.raises(CalibrationRejected, match="not follow the exposure"):
        response_of(values, EXPOSURES_MS, FULL)


@settings(max_examples=10)
@given(st.integers(0, 99))
@pytest.mark.slow
def test_gain_that_changes_by_itself_is_refused(seed: int) -> None:
    gain = np.random.default_rng(seed).uniform(0.8, 1.0, len(EXPOSURES_MS))
    with pytest.raises(CalibrationRejected, match=r"automatic|does not keep"):
        response_of(ladder(lambda light: light) * gain[:, None], EXPOSURES_MS, FULL)


def test_values_that_fall_at_a_longer_exposure_are_refused() -> None:
    values = ladder(gamma(2.2))
    values[-3] *= 0.8
    with pytest.raises(CalibrationRejected, match="values fall by"):
        response_of(values, EXPOSURES_MS, FULL)


@pytest.mark.parametrize(
    ("values", "match"),
    [
        (np.full((len(EXPOSURES_MS), 8), np.nan), "every exposure is saturated"),
        (ladder(lambda light: light) * 0.4, "brightest value is"),
        (np.where(np.arange(len(EXPOSURES_MS))[:, None] < 5, ladder(srgb), np.nan), "5 different"),
    ],
)
def test_too_little_to_see_is_refused(values: np.ndarray, match: str) -> None:
    with pytest.raises(CalibrationRejected, match=match):
        response_of(values, EXPOSURES_MS, FULL)


@pytest.mark.parametrize(
    ("shape", "times", "full_scale"),
    [((3, 4), np.ones(2), 255.0), ((4,), np.ones(4), 255.0), ((1, 1), -np.ones(1), 255.0)],
)
def test_values_of_another_shape_are_an_input_error(
    shape: tuple[int, ...], times: np.ndarray, full_scale: float
) -> None:
    with pytest.raises(InputError):
        response_of(np.ones(shape), times, full_scale)


def test_one_block_that_is_seen_at_every_exposure_is_enough() -> None:
    times = np.array([1.0, 2.0, 4.0, 8.0, 16.0, 32.0])
    assert response_of(100.0 * times[:, None], times, 4095.0).response.linear
