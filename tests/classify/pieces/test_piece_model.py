"""Pieces and wholes: faults are found as what they are, and good parts pass."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest

from classify import InputError, SurfaceEstimate, TextureLibrary
from classify.base.errors import PieceModelError
from classify.classifiers.joint import ring_means
from classify.pieces.features import CELL_PX, band_moments
from classify.pieces.learning import SCALE_STEP, GoodPart, learn_pieces, scaled_surface
from classify.pieces.piece_model import PieceMeasures, PieceModel

SIDE = 256
LEARNED = 12


def chiral(
    seed: int,
    orientation_deg: float = 0.0,
    *,
    mirrored: bool = False,
    second_deg: float = 40.0,
    scale: float = 1.0,
) -> SurfaceEstimate:
    """Coarse ripples along x, and fine ones at an angle to them: a texture with a handedness."""
    draw = np.random.default_rng(seed)
    x, y = np.arange(SIDE) - SIDE / 2.0, SIDE / 2.0 - np.arange(SIDE)
    lengths = scale * np.repeat((24.0, 7.0), 60) * 2.0 ** draw.normal(0.0, 0.1, 120)
    angles = np.repeat((0.0, second_deg), 60) + draw.normal(0.0, 8.0, 120)
    angles = np.radians((-angles if mirrored else angles) + orientation_deg)
    u, v = np.cos(angles), np.sin(angles)
    along_x = np.exp(2j * np.pi * (u / lengths)[:, None] * x)
    along_y = np.exp(2j * np.pi * (v / lengths) * y[:, None])
    phases = np.exp(2j * np.pi * draw.uniform(0.0, 1.0, 120))

    def field(weights: np.ndarray) -> np.ndarray:
        return (along_y * (weights * phases)) @ along_x

    p, q, albedo = 0.03 * field(u).real, 0.03 * field(v).real, 0.01 * field(np.ones(120)).imag
    noise = draw.normal(0.0, 0.005, (3, SIDE, SIDE))
    values = (p + noise[0], q + noise[1], 0.5 + albedo + noise[2])
    return SurfaceEstimate(
        *(each.astype(np.float32) for each in values), np.ones(p.shape, bool), "least_squares"
    )


class Taught:
    """A library and a piece model of the same good parts."""

    def __init__(self, surfaces: list[SurfaceEstimate]) -> None:
        self.library = TextureLibrary.train([("chiral", each, 0.0) for each in surfaces])
        parts = [GoodPart(band_moments(each), 0.0, self.rings(each)) for each in surfaces]
        steps = (-SCALE_STEP, SCALE_STEP)
        changes = [
            (self.rings(scaled_surface(each, 1.0 + step)) - part.rings) / math.log(1.0 + step)
            for each, part in zip(surfaces, parts, strict=True)
            for step in steps
        ]
        self.model = learn_pieces(parts, np.mean(changes, axis=0))

    def rings(self, surface: SurfaceEstimate) -> np.ndarray:
        return ring_means(self.library.observe(surface))

    def measure(self, surface: SurfaceEstimate, orientation_deg: float = 0.0) -> PieceMeasures:
        return self.model.measure(band_moments(surface), orientation_deg, self.rings(surface))


@pytest.fixture(scope="module")
def taught() -> Taught:
    return Taught([chiral(seed) for seed in range(LEARNED)])


@pytest.fixture
def good() -> SurfaceEstimate:
    return chiral(102)


def test_good_parts_are_seldom_beyond_a_limit(taught: Taught) -> None:
    found = [taught.measure(chiral(seed)) for seed in range(200, 210)]
    assert sum(max(each.window, each.seam, each.octaves) > 1.0 for each in found) <= 1
    for each in found:
        assert each.scale == pytest.approx(1.0, abs=0.03)
        assert each.handedness == pytest.approx(1.0, abs=0.6)


def test_three_parts_give_limits_that_good_parts_keep_and_show_a_direction() -> None:
    taught = Taught([chiral(seed) for seed in range(3)])
    found = taught.measure(chiral(106))
    assert max(found.window, found.seam, found.octaves) < 1.0
    assert taught.model.has_direction


def test_a_good_part_may_lie_at_any_orientation(taught: Taught) -> None:
    found = taught.measure(chiral(101, 50.0), 50.0)
    assert max(found.window, found.seam, found.octaves) < 1.0


def test_missing_texture_is_a_window_unlike_good_ones(
    taught: Taught, good: SurfaceEstimate
) -> None:
    hole = np.zeros((SIDE, SIDE), bool)
    hole[100:160, 60:120] = True
    flat = np.where(hole, 0.0, 1.0).astype(np.float32)
    part = replace(good, p=good.p * flat, q=good.q * flat)
    found = taught.measure(part)
    assert found.window > 1.5
    row, column = np.unravel_index(found.window_map.argmax(), found.window_map.shape)
    assert 100 // CELL_PX - 4 <= row <= 160 // CELL_PX + 4
    assert 60 // CELL_PX - 4 <= column <= 120 // CELL_PX + 4


def raised_cosine() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Height of a dent of 40 px, 1 px deep, and its slopes p and q."""
    y, x = 128.0 - np.arange(SIDE)[:, None], np.arange(SIDE) - 120.0
    phase = np.pi * np.minimum(np.hypot(x, y) / 20.0, 1.0)
    steep = 0.5 * (np.pi / 20.0) ** 2 * np.sinc(phase / np.pi)
    return -0.5 - 0.5 * np.cos(phase), steep * x, steep * y


@pytest.mark.parametrize("depth", [-4.0, 4.0])
def test_a_dent_is_a_spot_that_its_surroundings_do_not_let_expect(
    taught: Taught, good: SurfaceEstimate, depth: float
) -> None:
    _, p, q = (np.float32(depth) * each.astype(np.float32) for each in raised_cosine())
    assert worst_place(taught.measure(replace(good, p=good.p + p, q=good.q + q)))


@pytest.mark.parametrize("contrast", [-0.3, 0.3])
def test_a_stain_is_a_spot_that_its_surroundings_do_not_let_expect(
    taught: Taught, good: SurfaceEstimate, contrast: float
) -> None:
    height, _, _ = raised_cosine()
    stain = (1.0 + contrast * height).astype(np.float32)
    assert worst_place(taught.measure(replace(good, albedo=stain * good.albedo)))


@pytest.mark.parametrize("names", [("p", "q"), ("albedo",)])
def test_a_polished_or_washed_out_patch_is_a_spot(
    taught: Taught, good: SurfaceEstimate, names: tuple[str, ...]
) -> None:
    patch = raised_cosine()[0] < -0.3
    planes = {name: getattr(good, name) for name in names}
    smoothed = {
        name: np.where(patch, 0.5 * (plane + cv2.GaussianBlur(plane, (0, 0), 3.0)), plane)
        for name, plane in planes.items()
    }
    assert worst_place(taught.measure(replace(good, **smoothed)))


def worst_place(found: PieceMeasures) -> bool:
    """Whether the worst cell exceeds the limit and lies in the fault."""
    row, column = np.unravel_index(found.window_map.argmax(), found.window_map.shape)
    middle = np.hypot(row - 128 / CELL_PX, column - 120 / CELL_PX)
    return found.window > 1.0 and middle < 4.0


def test_a_piece_at_another_orientation_is_a_seam(taught: Taught, good: SurfaceEstimate) -> None:
    other = chiral(105, 90.0)
    half = np.arange(SIDE) < SIDE // 2
    part = replace(
        good,
        **{
            name: np.where(half, getattr(good, name), getattr(other, name))
            for name in ("p", "q", "albedo")
        },
    )
    assert taught.measure(part).seam > 1.5


@pytest.mark.parametrize("scale", [0.9, 0.95, 1.05, 1.1])
def test_another_scale_is_measured(taught: Taught, scale: float) -> None:
    found = math.log(taught.measure(chiral(104, scale=scale)).scale) / math.log(scale)
    assert 0.3 < found < 3.0


def test_a_mirrored_part_has_the_other_handedness(taught: Taught) -> None:
    assert taught.measure(chiral(103, mirrored=True)).handedness == pytest.approx(-1.0, abs=0.5)


def test_a_texture_that_is_its_own_mirror_image_has_no_handedness() -> None:
    found = Taught([chiral(seed, second_deg=0.0) for seed in range(LEARNED)])
    assert found.model.handedness is None
    assert found.model.has_direction
    assert found.measure(chiral(100, second_deg=0.0)).handedness is None


@pytest.mark.slow
def test_a_texture_without_a_direction_looks_alike_at_90_degrees() -> None:
    good = [chiral(seed) for seed in range(LEARNED)]
    whole = [round_texture(seed) for seed in range(LEARNED)]
    assert Taught(good).model.has_direction
    assert not Taught(whole).model.has_direction


def round_texture(seed: int) -> SurfaceEstimate:
    """Waves of all directions."""
    draw = np.random.default_rng(seed)
    k = np.hypot(*np.meshgrid(np.fft.fftfreq(SIDE), np.fft.fftfreq(SIDE)))
    weight = np.exp(-((np.log2(np.maximum(k, 1e-3) * 9.0)) ** 2))
    height = np.fft.ifft2(weight * np.fft.fft2(draw.normal(size=(SIDE, SIDE)))).real
    q, p = np.gradient(3.0 * height)
    noise = draw.normal(0.0, 0.005, (3, SIDE, SIDE))
    values = (p + noise[0], -q + noise[1], 0.5 + 0.02 * height + noise[2])
    return SurfaceEstimate(
        *(each.astype(np.float32) for each in values), np.ones(p.shape, bool), "least_squares"
    )


@pytest.mark.parametrize("depth", [0.7, 1.4])
def test_a_relief_of_another_depth_changes_octaves(
    taught: Taught, good: SurfaceEstimate, depth: float
) -> None:
    factor = np.float32(depth)
    assert taught.measure(replace(good, p=factor * good.p, q=factor * good.q)).octaves > 1.0


def test_a_model_is_read_as_it_was_written(taught: Taught, good: SurfaceEstimate, tmp_path) -> None:
    path = tmp_path / "x.ps4piece"
    taught.model.save(path)
    assert path.stat().st_size < 1_000_000
    read = PieceModel.load(path)
    assert read.sha256 == taught.model.sha256
    rings = taught.rings(good)
    found, again = (each.measure(band_moments(good), 0.0, rings) for each in (taught.model, read))
    np.testing.assert_array_equal(found.window_map, again.window_map)
    assert (found.scale, found.handedness) == (again.scale, again.handedness)


def test_a_damaged_model_is_refused(taught: Taught, tmp_path) -> None:
    path = tmp_path / "x.ps4piece"
    taught.model.save(path)
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    with pytest.raises(PieceModelError, match=r"x\.ps4piece"):
        PieceModel.load(path)


def test_too_few_parts_and_parts_of_different_sizes_are_refused(good: SurfaceEstimate) -> None:
    part = GoodPart(band_moments(good), 0.0, np.zeros(84))
    with pytest.raises(InputError, match="2 good parts"):
        learn_pieces([part] * 2, np.ones(84))
    smaller = GoodPart(part.moments[:-1], 0.0, part.rings)
    with pytest.raises(InputError, match="differ in the size"):
        learn_pieces([part, part, smaller], np.ones(84))
