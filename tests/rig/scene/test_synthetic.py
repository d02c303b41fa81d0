"""The 30 synthetic textures, and the twins of equal power spectrum."""

import zlib
from functools import cache

import cv2
import numpy as np
import pytest

from classify import Lighting
from rig.scene.material_folder import bundled_materials
from rig.scene.random_fields import ripples, rotated, summed
from rig.scene.render import render_scene
from rig.scene.surfaces import PeriodicSurface, SurfacePatch, rms_slope, round_band_limit
from rig.scene.synthetic import (
    ALBEDO,
    EQUAL_SPECTRUM_TWINS,
    SYNTHETIC_30,
    SYNTHETIC_NAMES,
    SYNTHETIC_TEXTURES,
    synthetic_surface,
)

SIDE = 256
SAME_RELIEF = {
    "rock_speckled": "rock", "malv_blotched": "malv", "sand_striped": "sand",
    "ripples_tinted": "ripples_fine",
}  # fmt: skip

# All textures; the fast tests use only those of the thesis.
FOUR_AND_MORE = [
    name if name in SYNTHETIC_NAMES else pytest.param(name, marks=pytest.mark.slow)
    for name in SYNTHETIC_TEXTURES
]


@cache
def surface_of(name: str, seed: int = 0) -> PeriodicSurface:
    return synthetic_surface(name, seed, SIDE)


def power(image: np.ndarray) -> np.ndarray:
    return np.abs(np.fft.fft2(image - image.mean())) ** 2 / image.size


def slope_power(surface: PeriodicSurface) -> np.ndarray:
    return power(surface.p) + power(surface.q)


BANDS = 11


@cache
def band_and_sector(side: int, sectors: int) -> np.ndarray:
    u, v = np.fft.fftfreq(side)[None, :], -np.fft.fftfreq(side)[:, None]
    band = np.digitize(np.hypot(u, v), np.geomspace(0.012, 0.44, BANDS + 1))
    sector = (np.arctan2(v, u) % np.pi / np.pi * sectors).astype(int) % sectors
    return (band * sectors + sector).ravel()


def banded(spectrum: np.ndarray, sectors: int = 6) -> np.ndarray:
    """Mean power in geometric bands of frequency and sectors of 180 degrees, (BANDS, sectors)."""
    where = band_and_sector(len(spectrum), sectors)
    cells = (BANDS + 2) * sectors
    power_sum = np.bincount(where, spectrum.ravel(), cells)
    return (power_sum / np.bincount(where, minlength=cells)).reshape(-1, sectors)[1:-1]


def skewness(values: np.ndarray) -> float:
    deviation = values.astype(float) - values.mean()
    return float((deviation**3).mean() / deviation.std() ** 3)


def test_there_are_30_textures_and_each_twin_has_its_original_among_them() -> None:
    assert SYNTHETIC_NAMES == ("rock", "sand", "malv", "ogil")
    assert SYNTHETIC_30[:4] == SYNTHETIC_NAMES
    assert len(SYNTHETIC_30) == 30
    assert set(EQUAL_SPECTRUM_TWINS.values()) < set(SYNTHETIC_30)
    assert (*SYNTHETIC_30, *EQUAL_SPECTRUM_TWINS) == SYNTHETIC_TEXTURES
    assert len(set(SYNTHETIC_TEXTURES)) == 32
    assert not set(SYNTHETIC_TEXTURES) & set(bundled_materials())
    # Names become parts of file names.
    assert all(name.replace("_", "").isalnum() for name in SYNTHETIC_TEXTURES)


@pytest.mark.parametrize(
    ("name", "formula"),
    [
        ("rock", lambda u, v: (u**2 + v**2) ** -1.5),
        ("malv", lambda u, v: ((u**2 + v**2) / 0.04**2 + 1) ** -1.5),
        ("ogil", lambda u, v: 1 / ((u**2 + 0.03**2) * (v**2 + 0.12**2))),
        ("sand", lambda u, v: np.exp(-(((np.abs(u) - 0.05) / 0.01) ** 2 + (v / 0.012) ** 2) / 2)),
    ],
)
def test_the_four_textures_of_the_thesis_are_filtered_white_noise(name: str, formula) -> None:  # type: ignore[no-untyped-def]
    """A library trained on seed 3 of rock fits seed 3 of rock in every version."""
    u, v = np.fft.rfftfreq(SIDE)[None, :], np.fft.fftfreq(SIDE)[:, None]
    noise = np.random.default_rng([3, zlib.crc32(name.encode())]).standard_normal((SIDE, SIDE))
    with np.errstate(divide="ignore"):
        amplitude = np.sqrt(formula(u, v)) * round_band_limit(SIDE, SIDE)
    amplitude[0, 0] = 0.0
    height = np.fft.irfft2(np.fft.rfft2(noise) * amplitude)
    surface = synthetic_surface(name, 3, SIDE)
    # This formula of sand omits the tail of the other lobe, 5 sigma away.
    scale = float((surface.height * height).sum() / (height**2).sum())
    assert np.abs(surface.height - scale * height).max() < 1e-3 * surface.height.std()
    assert rms_slope(surface.p, surface.q) == pytest.approx(0.5, rel=1e-3)
    assert (surface.albedo == np.float32(ALBEDO)).all()


def test_cells_do_not_depend_on_the_threads_of_opencv() -> None:
    """With one thread OpenCV takes its distances from another library, which rounds otherwise."""
    threads = cv2.getNumThreads()
    try:
        surfaces = []
        for count in (1, 2):
            cv2.setNumThreads(count)
            surfaces.append(synthetic_surface("cobbles", 0, SIDE))
    finally:
        cv2.setNumThreads(threads)
    np.testing.assert_array_equal(surfaces[0].height, surfaces[1].height)


@pytest.mark.parametrize("name", FOUR_AND_MORE)
def test_a_texture_is_scaled_band_limited_and_repeatable(name: str) -> None:
    surface, other = surface_of(name), surface_of(name, 1)
    again = synthetic_surface(name, 0, SIDE)
    np.testing.assert_array_equal(surface.height, again.height)
    np.testing.assert_array_equal(surface.albedo, again.albedo)
    assert abs(np.corrcoef(surface.p.ravel(), other.p.ravel())[0, 1]) < 0.3
    assert 0.4 <= rms_slope(surface.p, surface.q) <= 0.501
    assert np.abs([surface.p.mean(), surface.q.mean()]).max() < 1e-4
    assert 0.05 < surface.albedo.min() <= surface.albedo.max() <= 1.0
    beyond = np.hypot(*np.meshgrid(np.fft.fftfreq(SIDE), np.fft.fftfreq(SIDE))) > 0.485
    for spectrum in (slope_power(surface), power(surface.albedo)):
        assert spectrum[beyond].sum() <= 1e-8 * max(spectrum.sum(), 1.0)


@pytest.mark.parametrize("name", FOUR_AND_MORE)
def test_spectra_do_not_depend_on_the_size_of_the_tile(name: str) -> None:
    """Mean frequency and bandwidth, from eight small tiles and from two large ones."""
    small = [synthetic_surface(name, seed, 128) for seed in range(8)]
    large = [surface_of(name, seed) for seed in range(2)]

    def moments(channel, surfaces: list[PeriodicSurface]) -> tuple[float, float]:  # type: ignore[no-untyped-def]
        spectrum = sum(map(channel, surfaces))
        cycles = np.fft.fftfreq(len(spectrum))
        frequency = np.hypot(cycles[None, :], cycles[:, None])
        mean = np.average(frequency, weights=spectrum)
        return mean, np.sqrt(np.average((frequency - mean) ** 2, weights=spectrum))

    for channel in (slope_power, lambda s: power(s.albedo)):
        if channel(large[0]).max() > 1e-6:
            assert moments(channel, small) == pytest.approx(moments(channel, large), rel=0.12)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "partner"), [*EQUAL_SPECTRUM_TWINS.items(), *SAME_RELIEF.items()])
def test_two_textures_have_equal_power_spectra_of_relief(name: str, partner: str) -> None:
    seeds = range(6)
    ours, theirs = (
        banded(
            np.mean([slope_power(surface_of(texture, seed)) for seed in seeds], axis=0), sectors=2
        )
        for texture in (name, partner)
    )
    strong = theirs > 1e-3 * theirs.max()
    assert np.abs(np.log(ours / theirs))[strong].mean() < 0.15


def test_twins_differ_in_skewness() -> None:
    skew = {
        name: np.mean([skewness(surface_of(name, seed).height) for seed in range(4)])
        for name in ("domes", "pits", "cobbles", "cobbles_gaussian")
    }
    assert skew["domes"] > 1.0
    assert skew["pits"] == pytest.approx(-skew["domes"], abs=0.3)
    assert skew["cobbles"] < -1.0
    assert abs(skew["cobbles_gaussian"]) < 0.3
    for twin, partner in EQUAL_SPECTRUM_TWINS.items():
        assert (surface_of(twin).albedo == surface_of(partner).albedo).all()


def test_tinted_relief_is_brighter_where_it_is_high() -> None:
    surface = surface_of("ripples_tinted")
    assert np.corrcoef(surface.height.ravel(), surface.albedo.ravel())[0, 1] > 0.95


@pytest.mark.parametrize("name", FOUR_AND_MORE)
def test_only_low_lights_cast_shadow(name: str) -> None:
    tile = surface_of(name)
    patch = SurfacePatch(tile.height, tile.p, tile.q, tile.albedo)
    shadowed = [
        render_scene(patch, Lighting.ring(slant_deg), margin_px=48).shadowed.mean()
        for slant_deg in (30.0, 70.0)
    ]
    assert shadowed[0] < 0.01
    assert 0.1 < shadowed[1] < 0.35


@pytest.mark.parametrize("rotate_deg", [0.0, 30.0, 135.0])
def test_a_rotated_spectrum_belongs_to_a_surface_rotated_anticlockwise(rotate_deg: float) -> None:
    lobes = rotated(ripples(0.1, 0.01, 0.01), rotate_deg)
    u, v = np.meshgrid(np.fft.fftfreq(128), np.fft.fftfreq(128))
    weight = summed(lobes, lobes)(u, v)
    # Rows run down, so the frequency along y is -v.
    tensor = (weight * (u - 1j * v) ** 2).sum()
    assert np.degrees(np.angle(tensor)) / 2 % 180 == pytest.approx(rotate_deg, abs=0.5)


@pytest.mark.parametrize("name", FOUR_AND_MORE)
def test_the_smallest_tile_has_relief_for_every_seed(name: str) -> None:
    for seed in range(5):
        surface = synthetic_surface(name, seed, 16)
        assert rms_slope(surface.p, surface.q) > 0.3
