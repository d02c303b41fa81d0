"""Skewness, kurtosis and how fine detail keeps to coarse: what they know and what they ignore."""

import cv2
import numpy as np
import pytest
import scipy.ndimage
from hypothesis import given
from hypothesis import strategies as st

from classify.classifiers.joint_features import ALBEDO_GAINS
from classify.texture.fields import TextureFields, texture_fields
from classify.texture.spectra import MAX_SEGMENT_PX, segment_for
from classify.texture.statistics import (
    PARTS,
    LocalStatistics,
    levels_for,
    local_statistics,
    statistics_vector,
)

# Columns of the moments.
RELIEF, ALBEDO, RELIEF_3, ALBEDO_3, RELIEF_4, ALBEDO_4, BOTH, CURL = range(8)
# Each level of this side has a pixel in the middle, so that halving keeps to no corner.
ODD_SIDE = 129
QUARTERS = {"upper left": 1, "upper right": 2, "lower left": 3, "lower right": 4}


def fields_of(p: np.ndarray, q: np.ndarray, albedo: np.ndarray) -> TextureFields:
    return TextureFields(*(np.ascontiguousarray(each, np.float32) for each in (p, q, albedo)))


def quarter_turn(fields: TextureFields) -> TextureFields:
    """Turned anticlockwise by 90 degrees, slopes and all."""
    p, q, albedo = (np.rot90(each) for each in (fields.p, fields.q, fields.albedo))
    return fields_of(-q, p, albedo)


def mirrored(fields: TextureFields) -> TextureFields:
    return fields_of(-fields.p[:, ::-1], fields.q[:, ::-1], fields.albedo[:, ::-1])


def inverted(fields: TextureFields) -> TextureFields:
    """Pits for domes."""
    return fields_of(-fields.p, -fields.q, fields.albedo)


@pytest.fixture(scope="module")
def tinted(stationary) -> TextureFields:
    """Domes, the higher the brighter."""
    fields = texture_fields(stationary("domes", seed=3, side=ODD_SIDE))
    relief = -(np.gradient(fields.p, axis=1) - np.gradient(fields.q, axis=0))
    return fields_of(fields.p, fields.q, fields.albedo + 0.5 * relief)


def whole_close(one: LocalStatistics, other: LocalStatistics, rtol: float) -> None:
    """Of the whole frame, relative to the scale that each moment has."""
    for ours, theirs in ((one.moments, other.moments), (one.energies, other.energies)):
        np.testing.assert_allclose(ours[0], theirs[0], rtol=rtol, atol=rtol * np.abs(ours).max())


@pytest.mark.parametrize("change", [quarter_turn, mirrored], ids=lambda f: f.__name__)
def test_turning_and_mirroring_change_nothing(tinted, change) -> None:
    before, after = (local_statistics(each, 3) for each in (tinted, change(tinted)))
    assert np.abs(before.moments[0, :, [RELIEF_3, BOTH]]).min() > 1e-7
    np.testing.assert_allclose(after.moments[0], before.moments[0], rtol=2e-3, atol=1e-9)
    np.testing.assert_allclose(after.energies[0], before.energies[0], rtol=2e-3, atol=1e-4)


def test_a_turn_takes_each_quarter_to_the_next(tinted) -> None:
    before, after = (local_statistics(each, 1) for each in (tinted, quarter_turn(tinted)))
    for was, is_ in (
        ("upper right", "upper left"),
        ("upper left", "lower left"),
        ("lower left", "lower right"),
        ("lower right", "upper right"),
    ):
        ours, theirs = before.moments[QUARTERS[was], 0], after.moments[QUARTERS[is_], 0]
        # Of an odd side, one half has a line more than the other.
        assert theirs[RELIEF] == pytest.approx(ours[RELIEF], rel=0.05)


@pytest.mark.parametrize("side", [128, 150])
def test_an_even_side_turns_nearly_as_well(stationary, side: int) -> None:
    """Less than two realisations of one texture differ."""
    fields = texture_fields(stationary("domes", seed=4, side=side))
    other = texture_fields(stationary("domes", seed=5, side=side))
    floors = np.full(3, 1e-4)
    still, turned, another = (
        statistics_vector(local_statistics(each, 3), floors, floors)[0]
        for each in (fields, quarter_turn(fields), other)
    )
    assert np.linalg.norm(turned - still) < 0.5 * np.linalg.norm(another - still)


def test_pits_and_domes_differ_in_the_sign_of_skewness(stationary) -> None:
    domes, pits = (
        local_statistics(texture_fields(stationary(kind, seed=6)), 3) for kind in ("domes", "pits")
    )
    skewness = [
        each.moments[:, :, RELIEF_3] / each.moments[:, :, RELIEF] ** 1.5 for each in (domes, pits)
    ]
    # The coarsest levels, where the bumps are; the finest is all noise.
    assert (skewness[0][:, 1:] > 0.1).all()
    assert (skewness[1][:, 1:] < -0.1).all()


def test_turned_inside_out_odd_moments_change_sign_and_nothing_else(tinted) -> None:
    out, inside = (local_statistics(each, 3) for each in (tinted, inverted(tinted)))
    signs = np.ones(8)
    signs[[RELIEF_3, BOTH]] = -1.0
    np.testing.assert_allclose(inside.moments, signs * out.moments, rtol=1e-5, atol=1e-12)
    np.testing.assert_array_equal(inside.energies, out.energies)
    assert (out.moments[0, 0, BOTH] > 0).all()  # what stands out is bright


def test_dark_for_bright_changes_the_odd_moments_of_albedo(tinted) -> None:
    before = local_statistics(tinted, 3)
    after = local_statistics(fields_of(tinted.p, tinted.q, 2.0 - tinted.albedo), 3)
    signs = np.ones(8)
    signs[[ALBEDO_3, BOTH]] = -1.0
    np.testing.assert_allclose(after.moments, signs * before.moments, rtol=2e-3, atol=1e-6)


def test_the_finest_moments_are_those_of_plain_filters(tinted) -> None:
    """Scharr's derivatives and the Laplacian of nine points, by another library."""
    blur = [
        cv2.GaussianBlur(each, (5, 5), 0.8, borderType=cv2.BORDER_REFLECT_101).astype(float)
        for each in (tinted.p, tinted.q, tinted.albedo)
    ]
    scharr = np.outer([3, 10, 3], [-1, 0, 1]) / 32.0
    upwards = -scharr.T  # rows grow downwards
    laplacian = np.array([[1, 4, 1], [4, -20, 4], [1, 4, 1]]) / 6.0
    p, q, albedo = blur
    relief = -(scipy.ndimage.correlate(p, scharr) + scipy.ndimage.correlate(q, upwards))
    curl = scipy.ndimage.correlate(q, scharr) - scipy.ndimage.correlate(p, upwards)
    paint = -scipy.ndimage.correlate(albedo, laplacian)
    inside = np.s_[2:-2, 2:-2]
    z, a, e = (each[inside].ravel() - each[inside].mean() for each in (relief, paint, curl))
    expected = [
        (z**2).mean(), (a**2).mean(), (z**3).mean(), (a**3).mean(),
        (z**4).mean() - 3 * (z**2).mean() ** 2, (a**4).mean() - 3 * (a**2).mean() ** 2,
        (z * a).mean(), (e**2).mean(),
    ]  # fmt: skip
    np.testing.assert_allclose(local_statistics(tinted, 1).moments[0, 0], expected, rtol=1e-3)


@pytest.mark.parametrize("quarter", QUARTERS)
def test_each_quarter_is_measured_on_its_own(quarter: str) -> None:
    vertical, horizontal = quarter.split()
    rows = slice(0, 64) if vertical == "upper" else slice(64, 128)
    columns = slice(0, 64) if horizontal == "left" else slice(64, 128)
    p, q, albedo = np.zeros((3, 128, 128))
    albedo += 1.0
    noise = np.random.default_rng(0).standard_normal((3, 44, 44))
    for field, values in zip((p, q, albedo), noise, strict=True):
        field[rows, columns][10:-10, 10:-10] += values
    found = local_statistics(fields_of(p, q, albedo), 2).moments
    for name, row in QUARTERS.items():
        if name == quarter:
            assert (found[row, 0, [RELIEF, ALBEDO, CURL]] > 0.01).all()
            # A quarter of the pixels has all the variance.
            np.testing.assert_allclose(found[row, 0, RELIEF] / found[0, 0, RELIEF], 4.0, rtol=0.1)
        else:
            np.testing.assert_allclose(found[row, 0], 0.0, atol=1e-9)


def test_a_quarter_is_as_if_cut_out(stationary) -> None:
    """But for the borders."""
    fields = texture_fields(stationary("rough", seed=2, side=192))
    corner = fields_of(*(each[:96, :96] for each in (fields.p, fields.q, fields.albedo)))
    of_corner = local_statistics(corner, 2).moments[0]
    of_quarter = local_statistics(fields, 2).moments[1]
    np.testing.assert_allclose(of_quarter[:, RELIEF], of_corner[:, RELIEF], rtol=0.1)
    np.testing.assert_allclose(of_quarter[:, CURL], of_corner[:, CURL], rtol=0.1)


def test_the_gains_of_white_noise_are_those_the_joint_classifier_counts_with() -> None:
    draws = 0.1 * np.random.default_rng(0).standard_normal((4, 3, 512, 512))
    found = np.mean(
        [local_statistics(fields_of(p, q, 1.0 + a), 5).moments[0] for p, q, a in draws], axis=0
    )
    assert len(ALBEDO_GAINS) == len(found) == levels_for(MAX_SEGMENT_PX)
    np.testing.assert_allclose(found[:, ALBEDO] / found[:, CURL], ALBEDO_GAINS, rtol=0.15)
    np.testing.assert_allclose(found[:, RELIEF] / found[:, CURL], 1.0, rtol=0.15)


def test_a_relief_has_no_curl(texture) -> None:
    found = local_statistics(texture_fields(texture("grain", seed=1)), 3).moments
    assert (found[0, :, CURL] < 0.01 * found[0, :, RELIEF]).all()


def test_energies_are_covariances_of_all_levels(tinted) -> None:
    found = local_statistics(tinted, 3)
    assert found.levels == 3
    assert found.moments.shape == (1 + PARTS, 3, 8)
    assert found.energies.shape == (1 + PARTS, 6, 6)
    for covariance in found.energies:
        np.testing.assert_array_equal(covariance, covariance.T)
        assert np.linalg.eigvalsh(covariance).min() > -1e-6


def test_where_relief_and_paint_are_busy_together_their_energies_say_so(stationary) -> None:
    """The same flat patches in both, against flat patches elsewhere."""
    fields = texture_fields(stationary("rough", seed=7))
    paint = np.random.default_rng(8).standard_normal((128, 128))
    y, x = np.mgrid[:128, :128] // 16
    busy = ((x + y) % 2).astype(np.float32)
    together, apart = (
        local_statistics(fields_of(busy * fields.p, busy * fields.q, 1 + 0.1 * where * paint), 3)
        for where in (busy, 1 - busy)
    )
    # Finest relief with finest albedo.
    assert together.energies[0, 0, 1] > 0.1
    assert apart.energies[0, 0, 1] < -0.1


@given(st.integers(64, 4000), st.integers(64, 4000))
def test_every_frame_has_room_for_the_levels_of_its_library(rows: int, columns: int) -> None:
    levels = levels_for(segment_for((rows, columns)))
    assert min(rows, columns) >= 16 * 2**levels
    assert 2 <= levels <= 5


@pytest.mark.parametrize("shape", [(64, 64), (64, 300), (301, 64), (65, 67)])
def test_the_smallest_frames_have_statistics(shape: tuple[int, int]) -> None:
    p, q, albedo = np.random.default_rng(0).standard_normal((3, *shape))
    found = local_statistics(fields_of(p, q, albedo), 2)
    floors = np.full(2, 1e-6)
    assert np.isfinite(statistics_vector(found, floors, floors)).all()


@pytest.mark.filterwarnings("error")
def test_a_smooth_surface_has_finite_statistics() -> None:
    ones = np.ones((64, 80))
    found = local_statistics(fields_of(0.1 * ones, 0 * ones, ones), 2)
    np.testing.assert_allclose(found.moments, 0.0, atol=1e-9)
    floors = np.full(2, 1e-6)
    vector = statistics_vector(found, floors, floors)
    assert np.isfinite(vector).all()
    assert np.ptp(vector, axis=0).max() < 0.05  # its quarters are like the whole


def test_twice_the_relief_adds_to_one_number_a_level(tinted) -> None:
    """Its scale is told by the logarithm of the variance and by nothing else.

    Where relief is faint: of strong relief a small share counts as paint, as of a weak light.
    """
    nothing = np.zeros(3)
    one, two = (
        statistics_vector(
            local_statistics(fields_of(scale * tinted.p, scale * tinted.q, tinted.albedo), 3),
            nothing,
            nothing,
        )
        for scale in (0.02, 0.04)
    )
    np.testing.assert_allclose(two[:, :3] - one[:, :3], np.log(2.0), rtol=1e-4)
    np.testing.assert_allclose(two[:, 3:], one[:, 3:], rtol=1e-3, atol=1e-3)


def test_what_is_fainter_than_its_floor_differs_by_little() -> None:
    rng = np.random.default_rng(0)
    floors = np.full(2, 1.0)
    faint = [
        statistics_vector(
            local_statistics(fields_of(*(scale * rng.standard_normal((3, 64, 64)))), 2),
            floors,
            floors,
        )[0, :4]
        for scale in (1e-5, 1e-3)
    ]
    np.testing.assert_allclose(faint[0], faint[1], atol=1e-3)
