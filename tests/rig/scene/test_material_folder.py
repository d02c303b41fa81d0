"""Material folders: reading, scales and errors."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from classify.base.errors import InputError
from rig.scene.material_folder import bundled_materials, load_material
from rig.scene.surfaces import PeriodicSurface, rms_slope
from rig.scene.synthetic import synthetic_surface


@pytest.fixture(scope="module")
def truth() -> PeriodicSurface:
    """A surface of 64 x 128 px below the band limit of the reader."""
    rows, cols = np.mgrid[:64, :128]
    height = 3 * np.sin(2 * np.pi * (3 * cols / 128 - 2 * rows / 64)) + np.cos(
        2 * np.pi * (9 * cols / 128 + 4 * rows / 64)
    )
    return PeriodicSurface.from_height(height, np.ones((64, 128)), "truth")


def write_height(folder: Path, surface: PeriodicSurface, dtype: type = np.uint16) -> float:
    """Write height.png, black to white over the whole relief; return the relief in pixels."""
    white = np.iinfo(dtype).max
    units = (surface.height - surface.height.min()) / surface.relief_px
    cv2.imwrite(str(folder / "height.png"), np.round(units * white).astype(dtype))
    return surface.relief_px


def write_normal(
    folder: Path, surface: PeriodicSurface, name: str = "normal.png", white: int = 255
) -> None:
    normal = np.stack([-surface.p, -surface.q, np.ones_like(surface.p)], axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    rgb = np.round((normal + 1) / 2 * white).astype(np.uint8 if white == 255 else np.uint16)
    # A JPEG with colours at half resolution loses much of the slopes.
    full = [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]
    cv2.imwrite(str(folder / name), rgb[..., ::-1], [*full, cv2.IMWRITE_JPEG_QUALITY, 98])


def test_a_height_of_known_relief_keeps_its_scale(tmp_path: Path, truth: PeriodicSurface) -> None:
    relief_px = write_height(tmp_path, truth)
    # 128 px are 64 mm; other fields are ignored.
    notes = {"name": "oak", "licence": "CC0 1.0", "size_mm": 64, "relief_mm": relief_px / 2}
    (tmp_path / "material.json").write_text(json.dumps(notes))
    surface = load_material(tmp_path)
    assert surface.name == tmp_path.name
    assert np.ptp(surface.height) == pytest.approx(relief_px, rel=1e-4)
    np.testing.assert_allclose((surface.p, surface.q), (truth.p, truth.q), atol=1e-3)


@pytest.mark.parametrize("notes", [None, {"size_mm": 10}, {"relief_mm": 2.0}, {}])
def test_a_height_of_unknown_relief_gets_the_default_slope(
    tmp_path: Path, truth: PeriodicSurface, notes: dict[str, float] | None
) -> None:
    write_height(tmp_path, truth, np.uint8)
    if notes is not None:
        (tmp_path / "material.json").write_text(json.dumps(notes))
    surface = load_material(tmp_path)
    assert rms_slope(surface.p, surface.q) == pytest.approx(0.30, rel=0.01)
    assert np.corrcoef(surface.p.ravel(), truth.p.ravel())[0, 1] > 0.99
    np.testing.assert_allclose(surface.albedo, 0.8, atol=1e-5)


@pytest.mark.parametrize(
    ("name", "white", "bound"),
    [("normal.png", 255, 0.02), ("normal.png", 65535, 1e-3), ("normal.jpg", 255, 0.1)],
)
def test_a_normal_map_alone_gives_slopes_and_height(
    tmp_path: Path, truth: PeriodicSurface, name: str, white: int, bound: float
) -> None:
    write_normal(tmp_path, truth, name, white)
    surface = load_material(tmp_path)
    np.testing.assert_allclose((surface.p, surface.q), (truth.p, truth.q), atol=bound)
    level = truth.height - truth.height.mean()
    assert np.abs(surface.height - level).max() < 0.05 * truth.relief_px


def test_slopes_come_from_the_normal_map_and_scale_the_height(
    tmp_path: Path, truth: PeriodicSurface
) -> None:
    relief_px = write_height(tmp_path, truth)
    write_normal(tmp_path, truth)
    assert np.ptp(load_material(tmp_path).height) == pytest.approx(relief_px, rel=0.01)
    meta = {"height": {"scale_px_per_unit": 2.5}, "rms_slope": 0.1}
    (tmp_path / "meta.json").write_text(json.dumps(meta))
    surface = load_material(tmp_path)
    assert np.ptp(surface.height) == pytest.approx(2.5, rel=1e-3)
    np.testing.assert_allclose(surface.p, truth.p, atol=0.02)
    # material.json takes precedence over meta.json
    (tmp_path / "material.json").write_text('{"size_mm": 128, "relief_mm": 7}')
    assert np.ptp(load_material(tmp_path).height) == pytest.approx(7.0, rel=1e-3)


def test_slopes_of_flat_normals_are_limited(tmp_path: Path) -> None:
    normal = np.full((32, 32, 3), (255, 128, 128), np.uint8)  # B, G, R
    normal[10, 10] = (128, 128, 255)
    normal[20, 20] = (0, 0, 0)
    cv2.imwrite(str(tmp_path / "normal.png"), normal)
    surface = load_material(tmp_path)
    assert np.isfinite(surface.p).all()
    assert np.hypot(surface.p, surface.q).max() <= 10.0


def test_albedo_is_linear_luminance(tmp_path: Path, truth: PeriodicSurface) -> None:
    write_height(tmp_path, truth)
    for bgr, expected in (((188, 188, 188), 0.503), ((0, 0, 255), 0.2126), ((0, 255, 0), 0.7152)):
        cv2.imwrite(str(tmp_path / "albedo.png"), np.full((64, 128, 3), bgr, np.uint8))
        np.testing.assert_allclose(load_material(tmp_path).albedo, expected, atol=1e-3)


def test_a_constant_height_gives_a_flat_surface(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "height.png"), np.full((32, 32), 77, np.uint8))
    surface = load_material(tmp_path)
    assert not np.any((surface.p, surface.q))


def test_waves_that_would_alias_after_rotation_are_removed(tmp_path: Path) -> None:
    rows, cols = np.mgrid[:64, :64]
    low = np.cos(2 * np.pi * 20 * cols / 64)  # 0.31 cycles/px
    diagonal = np.cos(2 * np.pi * 28 * (cols + rows) / 64)  # 0.62 cycles/px
    both = PeriodicSurface.from_height(low + diagonal, np.ones((64, 64)), "both")
    np.testing.assert_allclose(both.band_limited().height, low, atol=1e-5)
    write_height(tmp_path, both)
    material = load_material(tmp_path)
    assert np.abs(material.q).max() < 1e-3 * np.abs(material.p).max()


def test_bundled_materials_are_complete_and_in_the_licence_file() -> None:
    folders = bundled_materials()
    assert len(folders) == 8
    licence = (next(iter(folders.values())).parent / "LICENSE.md").read_text()
    for name, folder in folders.items():
        surface = load_material(folder)
        assert surface.height.shape == (512, 512)
        assert 0.05 < rms_slope(surface.p, surface.q) < 0.6
        assert 0.03 < surface.albedo.mean() < 0.9
        assert name in licence
    assert sum(f.stat().st_size for d in folders.values() for f in d.iterdir()) < 2.5e6


def malv_map(side: int = 32) -> np.ndarray:
    return (40 * synthetic_surface("malv", 0, side).height + 128).clip(0, 255).astype(np.uint8)


def height_against_normals(folder: Path) -> None:
    surface = synthetic_surface("sand", 0, 64)
    write_height(folder, surface)
    flipped = PeriodicSurface(surface.height, -surface.p, -surface.q, surface.albedo, "flipped")
    write_normal(folder, flipped)


def normals_of_directx(folder: Path) -> None:
    (folder / "height.png").unlink()
    surface = synthetic_surface("sand", 0, 64)
    flipped = PeriodicSurface(surface.height, surface.p, -surface.q, surface.albedo, "flipped")
    write_normal(folder, flipped)


def image(name: str, pixels: np.ndarray) -> Callable[[Path], object]:
    return lambda folder: cv2.imwrite(str(folder / name), pixels)


def text(name: str, content: str, encoding: str = "utf-8") -> Callable[[Path], object]:
    return lambda folder: (folder / name).write_text(content, encoding)


def two_normals(folder: Path) -> None:
    for name in ("normal.png", "normal.jpg"):
        image(name, np.full((32, 32, 3), (255, 128, 128), np.uint8))(folder)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (shutil.rmtree, "no such material folder"),
        (lambda d: (d / "height.png").unlink(), r"no height\.png"),
        (text("height.png", "hello"), r"height\.png: .*PNG"),
        (text("normal.jpg", ""), r"normal\.jpg: not a complete"),
        (image("albedo.png", malv_map(16)), r"albedo\.png: 16 x 16 px"),
        (image("height.png", malv_map()[:4]), "32 x 4 px; the sides"),
        (image("height.png", np.zeros((8, 8200), np.uint8)), "8 to 8192"),
        (text("material.json", "{"), r"material\.json: .*Invalid JSON"),
        (text("material.json", '{"size_mm": "3"}'), r"material\.json: size_mm"),
        (text("material.json", '{"relief_mm": Infinity}'), "relief_mm: "),
        (text("meta.json", '{"height": {"scale_px_per_unit": "3"}}'), r"meta\.json: height\.scale"),
        (two_normals, "normal.png and normal.jpg"),
        (height_against_normals, "the normal map rises"),
        (normals_of_directx, r"normal\.png: the normals fit .* y pointing down"),
        (image("normal.png", np.zeros((32, 32, 3), np.uint8)), "away from the viewer"),
    ],
)
def test_a_bad_folder_gives_one_line_with_its_name(
    tmp_path: Path, spoil: Callable[[Path], object], words: str
) -> None:
    image("height.png", malv_map())(tmp_path)
    spoil(tmp_path)
    with pytest.raises(InputError, match=words) as caught:
        load_material(tmp_path)
    assert str(tmp_path) in str(caught.value)
    assert "\n" not in str(caught.value)
