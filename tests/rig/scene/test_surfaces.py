"""Periodic surfaces: resampling, shifting, rotating, gradients."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from classify.base.errors import InputError
from rig.scene.surfaces import (
    PeriodicSurface,
    View,
    periodic_height,
    rms_slope,
    spectral_gradients,
)
from rig.scene.synthetic import synthetic_surface, tile_side_px


@pytest.fixture(scope="module")
def malv() -> PeriodicSurface:
    return synthetic_surface("malv", seed=3, tile_px=128)


def wave(side: int, cycles_x: int, cycles_y: int) -> np.ndarray:
    """A cosine over one period, (side, side); y up."""
    rows, cols = np.mgrid[:side, :side]
    return np.cos(2 * np.pi * (cycles_x * cols - cycles_y * rows) / side + 0.3).astype(np.float32)


@pytest.mark.parametrize("shape", [(37, 50), (50, 37), (64, 32)])
def test_the_spline_passes_through_the_pixels_of_any_tile(shape: tuple[int, int]) -> None:
    noise = np.random.default_rng(0).standard_normal(shape).astype(np.float32)
    height = PeriodicSurface(noise, noise, noise, np.abs(noise), "noise").patch(View(31)).height
    top, left = ((side - 31) // 2 for side in shape)
    assert np.abs(height - noise[top : top + 31, left : left + 31]).max() < 1e-5


@pytest.mark.parametrize(("cycles", "bound"), [(19, 2e-4), (51, 7e-3)])
def test_spline_error_between_pixels(cycles: int, bound: float) -> None:
    """Waves of 0.15 and 0.4 cycles/px along an axis, the worst direction, rotated by 33 degrees."""
    side, angle = 128, np.radians(33.0)
    tile = wave(side, cycles, 0)
    patch = PeriodicSurface(tile, tile, tile, tile + 1.0, "wave").patch(View(side, 33.0))
    x = np.arange(side) - 63.5
    along = np.cos(angle) * x[None, :] + np.sin(angle) * -x[:, None]
    exact = np.cos(2 * np.pi * cycles * (63.5 + along) / side + 0.3)
    assert np.sqrt(2 * np.mean((patch.height - exact) ** 2)) < bound


@settings(deadline=None, max_examples=20)
@given(st.integers(-200, 200), st.integers(-200, 200), st.integers(1, 70))
def test_a_whole_shift_gives_the_pixels_of_the_tile(right: int, up: int, size: int) -> None:
    surface = synthetic_surface("ogil", seed=1, tile_px=64)
    patch = surface.patch(View(size, shift_px=(right, up)))
    rows = (np.arange(size) + (64 - size) // 2 - up) % 64
    cols = (np.arange(size) + (64 - size) // 2 + right) % 64
    for name in ("height", "p", "q", "albedo"):
        expected = getattr(surface, name)[np.ix_(rows, cols)]
        np.testing.assert_allclose(getattr(patch, name), expected, atol=2e-5)


def test_magnification_stretches_the_patch_about_its_centre(malv: PeriodicSurface) -> None:
    """At twice the size, every second pixel is one of the tile: sides are odd."""
    plain, large = (
        malv.patch(View(51, 20.0, (3.5, 1.0))),
        malv.patch(View(101, 20.0, (3.5, 1.0), 0, 2.0)),
    )
    np.testing.assert_allclose(large.height[::2, ::2], 2.0 * plain.height, atol=1e-4)
    for name in ("p", "q", "albedo"):
        np.testing.assert_allclose(getattr(large, name)[::2, ::2], getattr(plain, name), atol=1e-4)


@pytest.mark.parametrize("quarter", [1, 2, 3])
def test_rotation_by_90_degrees_rotates_the_arrays_anticlockwise(
    malv: PeriodicSurface, quarter: int
) -> None:
    still, rotated = malv.patch(View(100)), malv.patch(View(100, rotate_deg=90.0 * quarter))
    np.testing.assert_allclose(rotated.height, np.rot90(still.height, quarter), atol=1e-5)
    slope = still.p + 1j * still.q
    np.testing.assert_allclose(
        rotated.p + 1j * rotated.q, np.rot90(slope, quarter) * 1j**quarter, atol=1e-5
    )


@pytest.mark.parametrize("magnification", [1.0, 1.3])
def test_rotated_gradients_are_those_of_the_rotated_height(magnification: float) -> None:
    surface = synthetic_surface("sand", seed=2, tile_px=256)
    patch = surface.patch(View(150, 37.0, shift_px=(11.3, -4.6), magnification=magnification))
    # Fourth-order differences, with an error below 0.001 for ripples of 20 px.
    p, q = (
        (8 * (np.roll(patch.height, -s, a) - np.roll(patch.height, s, a))
         - (np.roll(patch.height, -2 * s, a) - np.roll(patch.height, 2 * s, a))) / 12
        for a, s in ((1, 1), (0, -1))
    )  # fmt: skip
    assert np.abs((p - patch.p, q - patch.q))[:, 3:-3, 3:-3].max() < 0.01
    assert rms_slope(patch.p, patch.q) > 0.3


def test_a_margin_only_adds_a_border(malv: PeriodicSurface) -> None:
    small = malv.patch(View(31, 20.0, (3.5, 1.0)))
    large = malv.patch(View(31, 20.0, (3.5, 1.0), margin_px=9))
    assert large.p.shape == (49, 49)
    np.testing.assert_allclose(large.p[9:-9, 9:-9], small.p, atol=1e-5)


def test_integration_inverts_differentiation() -> None:
    height = wave(64, 5, 3) + 2.0 * wave(64, 0, 9)
    p, q = spectral_gradients(height)
    rows, cols = np.mgrid[:64, :64]
    phase = 2 * np.pi * (5 * cols - 3 * rows) / 64 + 0.3
    np.testing.assert_allclose(p, -2 * np.pi * 5 / 64 * np.sin(phase), atol=1e-4)
    np.testing.assert_allclose(periodic_height(p, q), height - height.mean(), atol=1e-4)
    # y is up: a surface that rises with the row index falls with y
    assert np.corrcoef(np.gradient(height, axis=0).ravel(), q.ravel())[0, 1] < -0.9


def test_a_tile_is_at_least_twice_the_frame() -> None:
    assert [tile_side_px(size) for size in (1, 256, 257, 512, 1944, 8192)] == [
        512, 512, 1024, 1024, 4096, 4096,
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda s: s.patch(View(0)), "1 to 8192"),
        (lambda s: s.patch(View(10, margin_px=-1)), "margin"),
        (lambda s: s.patch(View(10, rotate_deg=float("nan"))), "finite"),
        (lambda s: s.patch(View(10, magnification=0.0)), "magnification"),
        (lambda _: synthetic_surface("granite", 0, 64), "rock, sand, malv, ogil"),
        (lambda _: synthetic_surface("rock", 0, 4), "16 to 8192"),
        (lambda s: PeriodicSurface(s.height, s.p, s.q[1:], s.albedo, "x"), "equal"),
        (lambda s: PeriodicSurface(s.height, s.p, s.q, -s.albedo, "x"), "negative"),
    ],
)
def test_bad_arguments_are_named(malv: PeriodicSurface, call, words: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(InputError, match=words):
        call(malv)
