"""Curvature against surfaces whose curvature is known."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from classify import InputError, SurfaceEstimate, surface_curvature

SurfaceOf = Callable[..., SurfaceEstimate]
Gradients = tuple[np.ndarray, np.ndarray]


def grid(rows: int = 96, columns: int = 120) -> tuple[np.ndarray, np.ndarray]:
    return np.meshgrid(np.arange(columns) - (columns - 1) / 2, (rows - 1) / 2 - np.arange(rows))


def ball(radius: float) -> Gradients:
    x, y = grid()
    z = np.sqrt(radius**2 - x * x - y * y)
    return -x / z, -y / z


def rod(radius: float, axis_deg: float) -> Gradients:
    x, y = grid()
    across = np.radians(axis_deg + 90.0)
    u = x * np.cos(across) + y * np.sin(across)
    slope = -u / np.sqrt(radius**2 - u * u)
    return slope * np.cos(across), slope * np.sin(across)


@pytest.fixture
def of(surface_of: SurfaceOf) -> Callable[[Gradients], SurfaceEstimate]:
    return lambda gradients: surface_of(*gradients, np.ones(gradients[0].shape))


@pytest.mark.parametrize("scale_px", [0.5, 1.0, 3.0])
def test_a_ball_has_its_curvature_up_to_the_border_at_any_scale(
    of: SurfaceOf, scale_px: float
) -> None:
    radius = 100.0
    found = surface_curvature(of(ball(radius)), scale_px)
    np.testing.assert_allclose(found.mean * radius, 1.0, rtol=1e-3)
    np.testing.assert_allclose(found.gaussian * radius**2, 1.0, rtol=2e-3)
    assert found.mean.dtype == found.gaussian.dtype == np.float32


@pytest.mark.parametrize("axis_deg", [0.0, 30.0, 45.0, 90.0, 135.0])
def test_a_rod_has_mean_but_no_gaussian_curvature(of: SurfaceOf, axis_deg: float) -> None:
    radius = 120.0
    found = surface_curvature(of(rod(radius, axis_deg)))
    np.testing.assert_allclose(found.mean * 2 * radius, 1.0, rtol=1e-3)
    np.testing.assert_allclose(found.gaussian * radius**2, 0.0, atol=1e-3)


@pytest.mark.parametrize("slopes", [(0.0, 0.0), (0.5, 0.0), (-0.3, 1.7)])
def test_a_tilted_plane_has_no_curvature(of: SurfaceOf, slopes: tuple[float, float]) -> None:
    found = surface_curvature(of(tuple(np.full((40, 50), slope) for slope in slopes)))
    np.testing.assert_allclose(found.mean, 0.0, atol=1e-6)
    np.testing.assert_allclose(found.gaussian, 0.0, atol=1e-7)


def test_curl_adds_no_curvature(of: SurfaceOf) -> None:
    """P = -c y, q = c x is no surface, p_y + q_x = 0. Where it is flat, H = K = 0."""
    x, y = grid(41, 41)
    found = surface_curvature(of((-0.02 * y, 0.02 * x)))
    assert abs(found.mean[20, 20]) < 1e-6
    assert abs(found.gaussian[20, 20]) < 1e-6  # unsymmetrised: 4e-4


@pytest.fixture(scope="module")
def egg_box() -> tuple[Gradients, np.ndarray, np.ndarray]:
    """Z = A sin(u x) cos(v y) with its curvatures as a Monge patch."""
    x, y = grid(160, 200)
    A, u, v = 3.0, 2 * np.pi / 40, 2 * np.pi / 60
    sx, cx, sy, cy = np.sin(u * x), np.cos(u * x), np.sin(v * y), np.cos(v * y)
    p, q = A * u * cx * cy, -A * v * sx * sy
    p_x, q_y, p_y = -A * u * u * sx * cy, -A * v * v * sx * cy, -A * u * v * cx * sy
    w2 = 1 + p * p + q * q
    H = -((1 + q * q) * p_x - 2 * p * q * p_y + (1 + p * p) * q_y) / (2 * w2**1.5)
    return (p, q), H, (p_x * q_y - p_y**2) / w2**2


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.square(values).mean()))


def test_an_egg_box_has_the_curvature_of_its_formula(
    of: SurfaceOf, egg_box: tuple[Gradients, np.ndarray, np.ndarray]
) -> None:
    gradients, H, K = egg_box
    found = surface_curvature(of(gradients))
    assert rms(found.mean - H) < 0.03 * rms(H)
    assert rms(found.gaussian - K) < 0.05 * rms(K)
    finer = surface_curvature(of(gradients), 0.5)
    assert rms(finer.mean - H) < 0.015 * rms(H)
    assert rms(finer.gaussian - K) < 0.02 * rms(K)


def test_wrong_slopes_affect_their_neighbours_only(
    of: SurfaceOf, egg_box: tuple[Gradients, np.ndarray, np.ndarray]
) -> None:
    (p, q), H, _ = egg_box
    rng = np.random.default_rng(1)
    wild = rng.random(p.shape) < 0.002
    p, q = np.where(wild, 30.0, p), np.where(wild, -30.0, q)
    assert rms(surface_curvature(of((p, q))).mean - H) < 0.25 * rms(H)


def test_noise_is_reduced_as_the_docstring_states(of: SurfaceOf) -> None:
    rng = np.random.default_rng(2)
    p, q = 0.01 * rng.standard_normal((2, 300, 300))
    for scale_px in (1.0, 2.0):
        found = surface_curvature(of((p, q)), scale_px)
        expected = 0.01 / (scale_px**2 * np.sqrt(8 * np.pi)) / np.sqrt(2)
        assert found.mean[10:-10, 10:-10].std() == pytest.approx(expected, rel=0.05)


def test_invalid_pixels_have_no_effect(of: SurfaceOf) -> None:
    """A ball with holes, a single pixel and an invalid stripe keeps its curvature."""
    radius = 100.0
    surface = of(ball(radius))
    valid = np.random.default_rng(3).random(surface.shape) > 0.2
    valid[40:50] = False
    nonsense = np.where(valid, np.float32(0), np.float32(np.nan))
    broken = replace(surface, p=surface.p + nonsense, q=surface.q + nonsense, valid=valid)
    found = surface_curvature(broken)
    assert (found.mean[~valid] == 0).all()
    assert (found.gaussian[~valid] == 0).all()
    np.testing.assert_allclose(found.mean[valid] * radius, 1.0, rtol=0.02)
    np.testing.assert_allclose(found.gaussian[valid] * radius**2, 1.0, rtol=0.04)


def test_strips_leave_no_seams(of: SurfaceOf, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(4)
    surface = of(tuple(rng.standard_normal((2, 150, 37))))
    whole = surface_curvature(surface)
    monkeypatch.setattr("classify.relief.curvature.STRIP_PX", 1)
    cut = surface_curvature(surface)
    np.testing.assert_allclose(cut.mean, whole.mean, atol=1e-6)
    np.testing.assert_allclose(cut.gaussian, whole.gaussian, atol=1e-6)


slopes = hnp.arrays(
    np.float32,
    st.tuples(st.just(2), st.integers(1, 24), st.integers(1, 24)),
    elements=st.floats(-3, 3, width=32),
)


@settings(deadline=None)
@given(slopes)
def test_a_rotated_surface_has_rotated_maps(surface_of: SurfaceOf, gradients: np.ndarray) -> None:
    """Rotation by 90 degrees anticlockwise takes (p, q) to (-q, p)."""
    p, q = gradients
    plain = surface_curvature(surface_of(p, q, np.ones(p.shape)))
    rotated = surface_curvature(surface_of(*np.rot90([-q, p], axes=(1, 2)), np.ones(p.T.shape)))
    np.testing.assert_allclose(rotated.mean, np.rot90(plain.mean), atol=1e-4)
    np.testing.assert_allclose(rotated.gaussian, np.rot90(plain.gaussian), atol=1e-4)


@settings(deadline=None)
@given(slopes)
def test_mirroring_keeps_curvature_and_inverting_negates_the_mean(
    surface_of: SurfaceOf, gradients: np.ndarray
) -> None:
    p, q = gradients
    ones = np.ones(p.shape)
    plain = surface_curvature(surface_of(p, q, ones))
    mirrored = surface_curvature(surface_of(-p[:, ::-1], q[:, ::-1], ones))
    inverted = surface_curvature(surface_of(-p, -q, ones))
    np.testing.assert_allclose(mirrored.mean[:, ::-1], plain.mean, atol=1e-4)
    np.testing.assert_allclose(mirrored.gaussian[:, ::-1], plain.gaussian, atol=1e-4)
    np.testing.assert_allclose(inverted.mean, -plain.mean, atol=1e-6)
    np.testing.assert_allclose(inverted.gaussian, plain.gaussian, atol=1e-6)


def test_one_pixel_and_one_row_have_curvature_along_their_extent(surface_of: SurfaceOf) -> None:
    one = np.ones((1, 1))
    found = surface_curvature(surface_of(one, one, one))
    assert found.mean.tolist() == found.gaussian.tolist() == [[0.0]]
    x = np.arange(-30, 31)[None, :]
    arc = surface_of(-x / np.sqrt(100.0**2 - x * x), 0 * x, np.ones(x.shape))
    row = surface_curvature(arc)
    np.testing.assert_allclose(row.mean * 200.0, 1.0, rtol=1e-3)
    np.testing.assert_allclose(row.gaussian, 0.0, atol=1e-8)


def test_a_surface_without_valid_pixels_has_zero_curvature(of: SurfaceOf) -> None:
    surface = of(ball(100.0))
    found = surface_curvature(replace(surface, valid=np.zeros(surface.shape, bool)))
    assert not found.mean.any()
    assert not found.gaussian.any()


@pytest.mark.parametrize("scale_px", [0.0, 0.4, -1.0, np.nan, np.inf])
def test_an_unusable_scale_is_named(of: SurfaceOf, scale_px: float) -> None:
    with pytest.raises(InputError, match=f"scale_px is {scale_px}"):
        surface_curvature(of(ball(100.0)), scale_px)


def test_a_slope_of_nan_is_refused(of: SurfaceOf) -> None:
    for bad in (np.nan, np.inf):
        p, q = ball(100.0)
        q[3, 4] = bad
        with pytest.raises(InputError, match="NaN or infinity"):
            surface_curvature(of((p, q)))
