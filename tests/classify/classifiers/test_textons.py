"""Textons, their histograms and the distance between histograms."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from classify.base.errors import InputError
from classify.classifiers.varma_zisserman import (
    TEXTONS_PER_CLASS,
    chi_squared,
    learn_textons,
    mr8_responses,
    texton_histogram,
)

HISTOGRAMS = arrays(np.float32, (3, 12), elements=st.integers(0, 20)).map(
    lambda counts: (counts + np.eye(3, 12)) / (counts + np.eye(3, 12)).sum(axis=1, keepdims=True)
)


def clustered(seed: int, centres: np.ndarray, spread: float = 0.05) -> np.ndarray:
    """(8, 40, 60) responses about some centres, equally many about each."""
    rng = np.random.default_rng(seed)
    which = rng.permutation(np.arange(2400) % len(centres))
    points = centres[which] + spread * rng.standard_normal((2400, 8))
    return points.T.reshape(8, 40, 60).astype(np.float32)


def texture(kind: str, seed: int, side: int = 128) -> np.ndarray:
    """An image of grain, of stripes whose direction depends on `seed`, or of blotches."""
    rng = np.random.default_rng(seed)
    u, v = np.fft.rfftfreq(side)[None, :], np.fft.fftfreq(side)[:, None]
    angle = np.pi * rng.random()
    along = np.cos(angle) * u + np.sin(angle) * v
    across = np.cos(angle) * v - np.sin(angle) * u
    gain = {
        "grain": (np.hypot(u, v) > 0.25).astype(float),
        "stripes": np.exp(-(((np.abs(along) - 0.1) / 0.02) ** 2) - (across / 0.02) ** 2),
        "blotches": np.exp(-((np.hypot(u, v) / 0.05) ** 2)),
    }[kind]
    values = np.fft.irfft2(gain * np.fft.rfft2(rng.standard_normal((side, side))))
    return np.clip(128 + 40 * values / values.std(), 0, 255).astype(np.uint8)


def test_textons_are_the_centres_of_clusters() -> None:
    centres = 3.0 * np.random.default_rng(5).standard_normal((TEXTONS_PER_CLASS, 8))
    found = learn_textons([clustered(1, centres), clustered(2, centres)])
    assert found.shape == (TEXTONS_PER_CLASS, 8)
    assert found.dtype == np.float32
    apart = np.linalg.norm(found[:, None] - centres[None], axis=2)
    # k-means may leave two centres in one cluster; most must be found
    assert (apart.min(axis=0) < 0.05).sum() >= TEXTONS_PER_CLASS - 2


def test_textons_do_not_depend_on_the_global_random_state() -> None:
    responses = [mr8_responses(texture("grain", seed)) for seed in range(5)]
    first = learn_textons(responses)
    np.random.default_rng().random(10)
    np.random.seed(99)  # noqa: NPY002
    np.testing.assert_array_equal(learn_textons(responses), first)


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 2**32 - 1), st.integers(1, 40), st.integers(1, 70))
def test_a_histogram_counts_each_pixel_at_its_nearest_texton(
    seed: int, count: int, rows: int
) -> None:
    rng = np.random.default_rng(seed)
    responses = rng.standard_normal((8, rows, 33)).astype(np.float32)
    textons = rng.standard_normal((count, 8)).astype(np.float32)
    found = texton_histogram(responses, textons)
    assert found.sum() == pytest.approx(1.0, abs=1e-5)
    pixels = responses.reshape(8, -1).T
    nearest = np.square(pixels[:, None] - textons[None]).sum(axis=2).argmin(axis=1)
    expected = np.bincount(nearest, minlength=count) / len(pixels)
    # a pixel midway between two may go to either
    np.testing.assert_allclose(found, expected, atol=1.5 / len(pixels))


@settings(deadline=None)
@given(HISTOGRAMS)
def test_chi_squared_is_symmetric_and_between_zero_and_one(histograms: np.ndarray) -> None:
    table = np.array([chi_squared(each, histograms) for each in histograms])
    np.testing.assert_allclose(table, table.T, atol=1e-6)
    np.testing.assert_array_equal(np.diag(table), 0.0)
    assert (table >= 0.0).all()
    assert (table <= 1.0 + 1e-6).all()
    a, b = histograms[:2]
    expected = 0.5 * sum((x - y) ** 2 / (x + y) for x, y in zip(a, b, strict=True) if x + y > 0)
    assert table[0, 1] == pytest.approx(expected, abs=1e-6)


def test_three_textures_are_recognised_in_any_orientation() -> None:
    kinds = ("grain", "stripes", "blotches")
    trained = [[mr8_responses(texture(kind, seed)) for seed in range(3)] for kind in kinds]
    textons = np.concatenate([learn_textons(responses) for responses in trained])
    assert textons.shape == (30, 8)
    labels = np.repeat(range(3), 3)
    references = np.array([texton_histogram(r, textons) for each in trained for r in each])
    for truth, kind in enumerate(kinds):
        for seed in range(100, 106):
            histogram = texton_histogram(mr8_responses(texture(kind, seed)), textons)
            assert labels[chi_squared(histogram, references).argmin()] == truth


def test_too_few_different_responses_are_refused() -> None:
    with pytest.raises(InputError, match="fewer than 10 different"):
        learn_textons([np.zeros((8, 20, 20), np.float32)])
