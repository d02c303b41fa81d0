"""Headings: the orientation of a texture over 360 degrees."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from classify import SurfaceEstimate, TextureLibrary
from classify.texture.fields import texture_fields
from classify.texture.heading import (
    HEADING_FLOATS,
    heading_features,
    heading_moments,
    heading_scores,
    heading_variances,
)
from classify.texture.statistics import local_statistics

SIDE = 192
SEEDS = st.integers(0, 2**32 - 1)


def sawtooth(
    surface_of, orientation_deg: float, seed: int, skew: float = 0.35, side: int = SIDE
) -> SurfaceEstimate:
    """Wavy, rough ripples, steeper on one side by `skew`, rotated anticlockwise."""
    rng = np.random.default_rng(seed)
    column, row = np.meshgrid(np.arange(side), -np.arange(side))
    angle = np.radians(orientation_deg)
    x = column * np.cos(angle) + row * np.sin(angle)
    y = row * np.cos(angle) - column * np.sin(angle)
    phase = 2 * np.pi * (x + 3.0 * np.sin(2 * np.pi * y / 70.0 + rng.uniform(0, 9))) / 12.0
    phase += rng.uniform(0, 2 * np.pi)
    slope = 0.3 * (np.cos(phase) + skew * np.cos(2 * phase))
    p, q, albedo = 0.05 * rng.standard_normal((3, side, side))
    return surface_of(
        p + slope * np.cos(angle), q + slope * np.sin(angle), 0.6 + 0.1 * albedo + 0 * slope
    )


@pytest.fixture(scope="module")
def library(stationary, surface_of) -> TextureLibrary:
    ripples, even = sawtooth(surface_of, 0.0, 0), sawtooth(surface_of, 0.0, 1, skew=0.0)
    others = [(kind, stationary(kind, seed=1, side=SIDE)) for kind in ("malv", "brushed")]
    return TextureLibrary.train([("sawtooth", ripples), ("even", even), *others])


@pytest.mark.parametrize("orientation_deg", [0.0, 33.0, 90.0, 150.0, 180.0, 213.0, 270.0, 341.0])
def test_a_steeper_side_gives_the_heading(library, surface_of, orientation_deg: float) -> None:
    match = library.classify(sawtooth(surface_of, orientation_deg, seed=int(orientation_deg) + 7))
    assert match.nearest == "sawtooth"
    assert abs((match.heading_deg - orientation_deg + 180.0) % 360.0 - 180.0) < 2.0
    assert match.heading_deg % 180.0 == pytest.approx(match.orientation_deg, abs=1e-5)


@pytest.mark.parametrize("orientation_deg", [20.0, 111.0, 200.0, 291.0])
def test_a_texture_with_equal_sides_has_no_heading(
    library, stationary, surface_of, orientation_deg: float
) -> None:
    even = library.classify(sawtooth(surface_of, orientation_deg, seed=3, skew=0.0))
    assert even.nearest == "even"
    assert even.heading_deg is None
    assert even.orientation_deg is not None
    for kind in ("malv", "brushed"):
        found = library.classify(stationary(kind, orientation_deg, seed=5, side=SIDE))
        assert found.label == kind
        assert found.heading_deg is None


def test_sets_of_a_class_are_aligned_over_the_full_circle(surface_of) -> None:
    """The second set is at 200 degrees, not at 20."""
    first, second = (sawtooth(surface_of, angle, seed) for angle, seed in ((0.0, 0), (200.0, 1)))
    library = TextureLibrary.train([("sawtooth", first), ("sawtooth", second)])
    assert library.orientations_deg[-1] == pytest.approx(200.0, abs=2.0)
    only_second = replace(
        library,
        labels=library.labels[-1:],
        orientations_deg=library.orientations_deg[-1:],
        signatures=library.signatures[-1:],
    )
    for asked in (library, only_second):
        match = asked.classify(sawtooth(surface_of, 75.0, 2))
        assert match.heading_deg == pytest.approx(75.0, abs=2.0)


def test_a_set_aligned_modulo_180_gives_no_heading(surface_of) -> None:
    """A skewed set that is aligned to an even one has an orientation modulo 180 only."""
    even, skewed = sawtooth(surface_of, 0.0, 0, skew=0.0), sawtooth(surface_of, 40.0, 1)
    library = TextureLibrary.train([("ripples", even), ("ripples", skewed)])
    match = library.classify(sawtooth(surface_of, 60.0, 2))
    assert match.orientation_deg == pytest.approx(60.0, abs=2.0)
    assert match.heading_deg is None


def test_known_orientations_are_kept_over_the_full_circle(surface_of) -> None:
    library = TextureLibrary.train([("sawtooth", sawtooth(surface_of, 10.0, 0), 250.0)])
    match = library.classify(sawtooth(surface_of, 10.0 + 30.0, 1))
    assert match.heading_deg == pytest.approx(280.0, abs=2.0)
    assert match.orientation_deg == pytest.approx(100.0, abs=2.0)


def measured(surface: SurfaceEstimate) -> np.ndarray:
    return local_statistics(texture_fields(surface), 3).headings


def test_moments_rotate_like_vectors(surface_of) -> None:
    """Rotated by 90 degrees, the pixels of each level of an odd frame stay pixels."""
    surface = sawtooth(surface_of, 25.0, 4, side=193)
    rotated = replace(
        surface,
        p=-np.rot90(surface.q),
        q=np.rot90(surface.p),
        albedo=np.rot90(surface.albedo),
        valid=np.rot90(surface.valid),
    )
    before, after = measured(surface), measured(rotated)
    assert before.shape == (5, 2, 6)
    factors = np.array([1j] * 5 + [-1j])
    np.testing.assert_allclose(after[0], factors * before[0], atol=1e-5)


def test_moments_are_those_of_their_definition() -> None:
    rng = np.random.default_rng(0)
    p, q, z, a = rng.standard_normal((4, 500))
    g = p + 1j * q
    products = [np.abs(g) ** 2 * g, z * z * g, a * g, a * a * g, a * z * g, g**3]
    parts = [part for product in products for part in (product.real.sum(), product.imag.sum())]
    sums = np.array([np.square(np.abs(g)).sum(), *parts])
    found = heading_moments(sums, np.array(500.0), np.array([z.var(), a.var()]))
    r, z_rms, a_rms = np.sqrt(np.square(np.abs(g)).mean()), z.std(), a.std()
    units = [r**3, z_rms**2 * r, a_rms * r, a_rms**2 * r, a_rms * z_rms * r, r**3]
    expected = [product.mean() / unit for product, unit in zip(products, units, strict=True)]
    np.testing.assert_allclose(found, expected, rtol=1e-9)


@settings(max_examples=50, deadline=None)
@given(SEEDS, st.floats(0.0, 360.0), st.integers(1, 4))
def test_the_opposite_orientation_has_the_opposite_score(
    seed: int, orientation_deg: float, levels: int
) -> None:
    rng = np.random.default_rng(seed)
    way = rng.standard_normal((levels, 6)) + 1j * rng.standard_normal((levels, 6))
    scatter = rng.standard_normal((5, levels, 6)) + 1j * rng.standard_normal((5, levels, 6))
    moments = 3.0 * way + 0.1 * scatter
    typical = heading_variances(moments)
    reference = heading_features(moments, typical)
    assert reference.shape == (HEADING_FLOATS,)
    spins = np.array([1, 1, 1, 1, 1, 3])
    rotated = heading_features(moments * np.exp(1j * np.radians(orientation_deg) * spins), typical)
    (score,) = heading_scores(rotated, reference[None], np.array([orientation_deg]))
    (other,) = heading_scores(rotated, reference[None], np.array([orientation_deg + 180.0]))
    assert score > 4.0
    assert other == pytest.approx(-score, rel=1e-4)


def test_moments_within_their_scatter_give_no_heading() -> None:
    rng = np.random.default_rng(1)
    moments = rng.standard_normal((5, 3, 6)) + 1j * rng.standard_normal((5, 3, 6))
    moments[0] = moments[1:].mean(axis=0)
    numbers = heading_features(moments, heading_variances(moments))
    assert (numbers[-HEADING_FLOATS // 3 :] == 0.0).all()
    assert heading_scores(numbers, numbers[None], np.zeros(1)).tolist() == [0.0]
