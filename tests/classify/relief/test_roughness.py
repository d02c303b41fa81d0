"""ISO 25178-2 parameters of surfaces whose parameters are known."""

from collections.abc import Callable
from dataclasses import astuple, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from classify import InputError, SurfaceEstimate, surface_roughness
from classify.relief.roughness import root_mean_square_slope

SurfaceOf = Callable[..., SurfaceEstimate]


def test_a_tilted_plane_has_slope_and_area_but_no_roughness(surface_of: SurfaceOf) -> None:
    ones = np.ones((40, 60))
    found = surface_roughness(surface_of(0.3 * ones, -0.4 * ones, ones))
    assert found.sdq == pytest.approx(0.5, rel=1e-6)
    assert found.sdr_percent == pytest.approx(100 * (np.sqrt(1.25) - 1), rel=1e-6)
    assert found.sa_px == pytest.approx(0.0, abs=1e-4)
    assert found.sq_px == pytest.approx(0.0, abs=1e-4)
    assert found.valid_pixels == 2400


def test_a_sinusoid_has_the_parameters_of_its_formula(surface_of: SurfaceOf) -> None:
    """Z = A sin(kx) over whole waves: Sq = A/sqrt 2, Sa = 2A/pi, Sdq = Ak/sqrt 2."""
    A, k = 2.0, 2 * np.pi / 25
    x = np.arange(500) - 249.5
    p = np.tile(A * k * np.cos(k * x), (30, 1))
    found = surface_roughness(surface_of(p, 0 * p, np.ones(p.shape)))
    assert found.sdq == pytest.approx(A * k / np.sqrt(2), rel=1e-4)
    fine = np.linspace(0, 2 * np.pi, 10_000, endpoint=False)
    area = np.sqrt(1 + (A * k * np.cos(fine)) ** 2).mean()
    assert found.sdr_percent == pytest.approx(100 * (area - 1), rel=1e-4)
    assert found.sq_px == pytest.approx(A / np.sqrt(2), rel=0.02)
    assert found.sa_px == pytest.approx(2 * A / np.pi, rel=0.02)


def test_a_ball_has_the_area_of_its_zone(surface_of: SurfaceOf) -> None:
    """A cap of height h has area 2 pi R h."""
    radius, a = 300.0, 180.0
    x, y = np.meshgrid(np.arange(400) - 199.5, 199.5 - np.arange(400))
    disc = x * x + y * y < a * a
    z = np.sqrt(np.where(disc, radius**2 - x * x - y * y, 1.0))
    surface = surface_of(np.where(disc, -x / z, 9.0), np.where(disc, -y / z, 9.0), 0 * x)
    found = surface_roughness(replace(surface, valid=disc), z.astype(np.float32))
    cap = 2 * np.pi * radius * (radius - np.sqrt(radius**2 - a * a))
    assert found.sdr_percent == pytest.approx(100 * (cap / (np.pi * a * a) - 1), rel=2e-3)
    # mean of r^2 / (R^2 - r^2) over the disc
    u = (a / radius) ** 2
    assert found.sdq == pytest.approx(np.sqrt(-np.log(1 - u) / u - 1), rel=2e-3)


def test_a_nearly_flat_surface_keeps_its_digits(surface_of: SurfaceOf) -> None:
    slope = np.full((5, 5), 1e-5)
    found = surface_roughness(surface_of(slope, 0 * slope, slope))
    assert found.sdr_percent == pytest.approx(100 * 0.5e-10, rel=1e-3)


def test_a_given_height_is_levelled_and_used(surface_of: SurfaceOf) -> None:
    x, y = np.meshgrid(np.arange(50), np.arange(40))
    steps = np.where((x + y) % 2 == 0, 1.5, -1.5)
    height = (steps + 0.7 * x - 3 * y + 1000).astype(np.float32)
    surface = surface_of(0 * steps, 0 * steps, steps)
    found = surface_roughness(surface, height)
    assert found.sdq == found.sdr_percent == 0.0
    assert found.sa_px == pytest.approx(1.5, rel=1e-3)
    assert found.sq_px == pytest.approx(1.5, rel=1e-3)


@settings(deadline=None)
@given(
    hnp.arrays(
        np.float32,
        st.tuples(st.just(3), st.integers(1, 20), st.integers(1, 20)),
        elements=st.floats(-3, 3, width=32),
    )
)
def test_rotating_or_mirroring_the_surface_changes_nothing(
    surface_of: SurfaceOf, values: np.ndarray
) -> None:
    p, q, mask = values
    valid = mask >= 0
    valid[0, 0] = True
    plain = surface_roughness(replace(surface_of(p, q, 0 * p), valid=valid))
    rotated_p, rotated_q = np.rot90([-q, p], axes=(1, 2))
    rotated = surface_roughness(
        replace(surface_of(rotated_p, rotated_q, 0 * rotated_p), valid=np.rot90(valid))
    )
    mirrored = surface_roughness(
        replace(surface_of(-p[:, ::-1], q[:, ::-1], 0 * p), valid=valid[:, ::-1])
    )
    assert astuple(rotated) == pytest.approx(astuple(plain), rel=1e-3, abs=1e-4)
    assert astuple(mirrored) == pytest.approx(astuple(plain), rel=1e-3, abs=1e-4)
    assert plain.sa_px <= plain.sq_px * (1 + 1e-5) + 1e-6
    assert plain.sdr_percent <= 50 * plain.sdq**2 * (1 + 1e-5)


def test_only_valid_pixels_count(surface_of: SurfaceOf) -> None:
    p = np.full((10, 10), 0.2)
    surface = surface_of(p, 0 * p, p)
    valid = np.zeros(p.shape, bool)
    valid[2:5] = True
    wild = surface.p.copy()
    wild[~valid] = np.nan
    found = surface_roughness(replace(surface, p=wild, valid=valid), np.zeros_like(wild))
    assert found.sdq == pytest.approx(0.2, rel=1e-6)
    assert found.valid_pixels == 30


def test_a_single_pixel_has_a_slope_and_no_height(surface_of: SurfaceOf) -> None:
    one = np.ones((1, 1))
    found = surface_roughness(surface_of(one, one, one))
    assert found.sdq == pytest.approx(np.sqrt(2))
    assert found.sa_px == found.sq_px == 0.0


def test_unusable_input_is_named(surface_of: SurfaceOf) -> None:
    ones = np.ones((4, 5))
    surface = surface_of(ones, ones, ones)
    with pytest.raises(InputError, match=r"no pixel .* valid"):
        surface_roughness(replace(surface, valid=np.zeros((4, 5), bool)))
    with pytest.raises(InputError, match=r"\(5, 4\), .* \(4, 5\)"):
        surface_roughness(surface, np.zeros((5, 4), np.float32))
    for bad in (np.nan, np.inf):
        p = surface.p.copy()
        p[1, 1] = bad
        with pytest.raises(InputError, match="NaN or infinity"):
            surface_roughness(replace(surface, p=p), np.zeros((4, 5), np.float32))
        with pytest.raises(InputError, match="NaN or infinity"):
            surface_roughness(surface, np.full((4, 5), bad, np.float32))


def test_the_slope_alone_is_that_of_all_parameters() -> None:
    draw = np.random.default_rng(5)
    p, q = draw.normal(size=(2, 40, 50)).astype(np.float32)
    valid = draw.random((40, 50)) < 0.7
    surface = SurfaceEstimate(p, q, np.ones_like(p), valid, "ps4")
    assert root_mean_square_slope(surface) == pytest.approx(surface_roughness(surface).sdq)
    nowhere = SurfaceEstimate(p, q, np.ones_like(p), np.zeros_like(valid), "ps4")
    assert np.isnan(root_mean_square_slope(nowhere))
