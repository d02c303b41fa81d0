"""The MR8 filters and responses, against plain convolution."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from classify.base.errors import InputError
from classify.classifiers.varma_zisserman import FILTER_PX, mr8_filters, mr8_responses

EDGES, BARS = slice(0, 18), slice(18, 36)
GAUSSIAN, LAPLACIAN = 36, 37


def noise(*shape: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, shape).astype(np.uint8)


def convolved(image: np.ndarray) -> np.ndarray:
    """The definition, filter by filter, in double precision."""
    values = (image - image.mean()) / image.std()
    inside = np.s_[FILTER_PX // 2 : -(FILTER_PX // 2), FILTER_PX // 2 : -(FILTER_PX // 2)]
    flipped = mr8_filters().astype(float)[:, ::-1, ::-1]
    each = [cv2.filter2D(values, cv2.CV_64F, kernel)[inside] for kernel in flipped]
    strongest = [np.abs(each[6 * k : 6 * k + 6]).max(axis=0) for k in range(6)]
    responses = np.array([*strongest, each[GAUSSIAN], each[LAPLACIAN]])
    magnitude = np.linalg.norm(responses, axis=0)
    return responses * np.log(1 + magnitude / 0.03) / magnitude


def test_38_filters_of_mean_zero_and_of_l1_norm_one() -> None:
    filters = mr8_filters().astype(float)
    assert filters.shape == (38, FILTER_PX, FILTER_PX)
    np.testing.assert_allclose(filters.mean(axis=(1, 2)), 0.0, atol=1e-8)
    np.testing.assert_allclose(np.abs(filters).sum(axis=(1, 2)), 1.0, rtol=1e-5)


def test_edges_are_odd_and_all_others_even() -> None:
    filters = mr8_filters()
    rotated = filters[:, ::-1, ::-1]
    np.testing.assert_allclose(rotated[EDGES], -filters[EDGES], atol=1e-7)
    np.testing.assert_allclose(rotated[18:], filters[18:], atol=1e-7)


def test_filters_90_degrees_apart_are_rotated_copies() -> None:
    filters = mr8_filters()[:36].reshape(6, 6, FILTER_PX, FILTER_PX)
    # float32 rounds the two differently by the last bit
    np.testing.assert_allclose(filters[:, 3:], np.rot90(filters[:, :3], axes=(2, 3)), atol=1e-7)


@pytest.mark.parametrize(("first", "sigma"), [(18, 1.0), (24, 2.0), (30, 4.0)])
def test_a_bar_is_three_times_as_long_as_wide(first: int, sigma: float) -> None:
    """Its profile is a Gaussian of 3 sigma along, and zero at +-sigma across."""
    bar, centre = mr8_filters()[first].astype(float), FILTER_PX // 2
    bar = bar - bar[0, 0]  # the mean that was subtracted
    along = bar[:, centre] / bar[centre, centre]
    expected = np.exp(-0.5 * (np.arange(FILTER_PX) - centre) ** 2 / (3 * sigma) ** 2)
    np.testing.assert_allclose(along, expected, atol=0.03)
    at_sigma = bar[centre, centre + int(sigma)]
    assert abs(at_sigma) < 0.03 * abs(bar[centre, centre])


@pytest.mark.parametrize("shape", [(64, 64), (70, 101), (75, 560)])
def test_responses_are_the_convolution_of_the_definition(shape: tuple[int, int]) -> None:
    """Also where the image is cut into blocks."""
    image = noise(*shape)
    found = mr8_responses(image)
    assert found.dtype == np.float32
    assert found.shape == (8, shape[0] - 48, shape[1] - 48)
    np.testing.assert_allclose(found, convolved(image), atol=2e-5)


@settings(deadline=None, max_examples=20)
@given(st.floats(0.01, 100.0), st.floats(-1000.0, 1000.0))
def test_exposure_and_offset_do_not_matter(gain: float, offset: float) -> None:
    image = noise(66, 64).astype(np.float64)
    np.testing.assert_allclose(
        mr8_responses(image * gain + offset), mr8_responses(image), atol=5e-3
    )


@settings(deadline=None, max_examples=20)
@given(arrays(np.uint16, (64, 64), elements=st.integers(0, 65535)))
def test_any_image_that_is_not_constant_has_finite_responses(image: np.ndarray) -> None:
    if image.min() == image.max():
        with pytest.raises(InputError, match="constant"):
            mr8_responses(image)
    else:
        responses = mr8_responses(image)
        assert np.isfinite(responses).all()
        assert (responses[:6] >= 0).all()


@pytest.mark.parametrize(
    ("image", "words"),
    [
        (noise(63, 200), r"\(63, 200\).*at least 64"),
        (noise(3, 70, 70), r"\(3, 70, 70\)"),
        (np.full((70, 70), 7, np.uint8), "constant, 7"),
        (np.full((300, 300), 0.1, np.float32), "constant, 0.1"),
        (np.where(np.eye(70), np.nan, 1.0), "NaN"),
    ],
)
def test_images_without_texture_are_refused(image: np.ndarray, words: str) -> None:
    with pytest.raises(InputError, match=words):
        mr8_responses(image)
