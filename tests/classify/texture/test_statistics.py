"""Local statistics: symmetries, quarters, scales and floors."""

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
    levels_for,
    local_statistics,
    statistics_vector,
)

# Columns of the moments.
RELIEF, ALBEDO, RELIEF_3, ALBEDO_3, RELIEF_4, ALBEDO_4, BOTH, CURL = range(8)
# Each level of this side has a pixel in its middle, so that halving is symmetric.
ODD_SIDE = 129
QUARTERS = {"upper left": 1, "upper right": 2, "lower left": 3, "lower right": 4}


def fields_of(p: np.ndarray, q: np.ndarray, albedo: np.ndarray) -> TextureFields:
    return TextureFields(*(np.ascontiguousarray(each, np.float32) for each in (p, q, albedo)))


def vector(fields: TextureFields, levels: int, floor: float) -> np.ndarray:
    floors = np.full(levels, floor)
    return statistics_vector(local_statistics(fields, levels), floors, floors)


def rotated_by_90(fields: TextureFields) -> TextureFields:
    """Rotate the frame and its slopes anticlockwise."""
    p, q, albedo = (np.rot90(each) for each in (fields.p, fields.q, fields.albedo))
    return fields_of(-q, p, albedo)


def mirrored(fields: TextureFields) -> TextureFields:
    return fields_of(-fields.p[:, ::-1], fields.q[:, ::-1], fields.albedo[:, ::-1])


def inverted(fields: TextureFields) -> TextureFields:
    """Pits instead of domes."""
    return fields_of(-fields.p, -fields.q, fields.albedo)


@pytest.fixture(scope="module")
def tinted(stationary) -> TextureFields:
    """Domes that are brighter where they are higher."""
    fields = texture_fields(stationary("domes", seed=3, side=ODD_SIDE))
    relief = -(np.gradient(fields.p, axis=1) - np.gradient(fields.q, axis=0))
    return fields_of(fields.p, fields.q, fields.albedo + 0.5 * relief)


@pytest.mark.parametrize("change", [rotated_by_90, mirrored], ids=lambda f: f.__name__)
def test_rotations_and_mirroring_change_nothing(tinted, change) -> None:
    before, after = (local_statistics(each, 3) for each in (tinted, change(tinted)))
    assert np.abs(before.moments[0, :, [RELIEF_3, BOTH]]).min() > 1e-7
    np.testing.assert_allclose(after.moments[0], before.moments[0], rtol=2e-3, atol=1e-9)
    np.testing.assert_allclose(after.energies[0], before.energies[0], rtol=2e-3, atol=1e-4)


def test_pits_and_domes_differ_in_the_sign_of_skewness(stationary) -> None:
    domes, pits = (
        local_statistics(texture_fields(stationary(kind, seed=6)), 3) for kind in ("domes", "pits")
    )
    skewness = [
        each.moments[:, :, RELIEF_3] / each.moments[:, :, RELIEF] ** 1.5 for each in (domes, pits)
    ]
    # The bumps are on the coarser levels; the finest is noise.
    assert (skewness[0][:, 1:] > 0.1).all()
    assert (skewness[1][:, 1:] < -0.1).all()


def test_inversion_changes_the_sign_of_odd_moments_only(tinted) -> None:
    negative = fields_of(tinted.p, tinted.q, 2.0 - tinted.albedo)
    before, inside, dark = (
        local_statistics(each, 3) for each in (tinted, inverted(tinted), negative)
    )
    signs, signs_of_albedo = np.ones((2, 8))
    signs[[RELIEF_3, BOTH]] = signs_of_albedo[[ALBEDO_3, BOTH]] = -1.0
    np.testing.assert_allclose(inside.moments, signs * before.moments, rtol=1e-5, atol=1e-12)
    np.testing.assert_allclose(dark.moments, signs_of_albedo * before.moments, rtol=2e-3, atol=1e-6)
    np.testing.assert_array_equal(inside.energies, before.energies)
    assert (before.moments[0, 0, BOTH] > 0).all()  # high places are bright


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


def test_white_noise_has_the_albedo_gains_of_the_joint_classifier() -> None:
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


def test_energies_correlate_where_relief_and_paint_share_their_places(stationary) -> None:
    """Flat patches in the same places of both, against flat patches in others."""
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
def test_every_frame_is_large_enough_for_the_levels_of_its_library(rows: int, columns: int) -> None:
    levels = levels_for(segment_for((rows, columns)))
    assert min(rows, columns) >= 16 * 2**levels
    assert 2 <= levels <= 5


@pytest.mark.parametrize("shape", [(64, 64), (64, 300), (301, 64), (65, 67)])
def test_the_smallest_frames_have_statistics(shape: tuple[int, int]) -> None:
    p, q, albedo = np.random.default_rng(0).standard_normal((3, *shape))
    assert np.isfinite(vector(fields_of(p, q, albedo), 2, 1e-6)).all()


@pytest.mark.filterwarnings("error")
def test_a_smooth_surface_has_finite_statistics() -> None:
    ones = np.ones((64, 80))
    smooth = fields_of(0.1 * ones, 0 * ones, ones)
    np.testing.assert_allclose(local_statistics(smooth, 2).moments, 0.0, atol=1e-9)
    found = vector(smooth, 2, 1e-6)
    assert np.isfinite(found).all()
    assert np.ptp(found, axis=0).max() < 0.05  # the quarters are like the frame


def test_twice_the_relief_adds_to_one_number_a_level(tinted) -> None:
    """Only the logarithm of the variance depends on the scale of a faint relief.

    Of a strong relief a small share counts as paint.
    """
    one, two = (
        vector(fields_of(scale * tinted.p, scale * tinted.q, tinted.albedo), 3, 0.0)
        for scale in (0.02, 0.04)
    )
    np.testing.assert_allclose(two[:, :3] - one[:, :3], np.log(2.0), rtol=1e-4)
    np.testing.assert_allclose(two[:, 3:], one[:, 3:], rtol=1e-3, atol=1e-3)


def test_textures_fainter_than_their_floors_differ_little() -> None:
    rng = np.random.default_rng(0)
    faint = [
        vector(fields_of(*(scale * rng.standard_normal((3, 64, 64)))), 2, 1.0)[0, :4]
        for scale in (1e-5, 1e-3)
    ]
    np.testing.assert_allclose(faint[0], faint[1], atol=1e-3)
