"""Sets and maps in napari, by npe2: the part of napari that knows its plugins."""

import subprocess
import sys
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from npe2 import PluginManager, PluginManifest
from npe2.cli import app
from npe2.io_utils import read
from typer.testing import CliRunner

from capture import CapturedSet
from capture.maps.files import write_maps
from capture.maps.napari_reader import get_reader
from rig.set_file import pixels_sha256

ROOT = Path(__file__).parents[3]
MANIFEST = ROOT / "capture" / "napari.yaml"
SETS = ROOT / "tests" / "data" / "sets"
SET = SETS / "rock.ome.tif"
MM_PER_PX = 0.02
Opened = Callable[[Path], dict[str, tuple[np.ndarray, dict[str, Any], str]]]


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> Iterator[Opened]:
    """Read a path as napari does with ps4rig alone, into layers by name."""
    manager = PluginManager(reg=None)
    manager.register(PluginManifest.from_file(MANIFEST))
    monkeypatch.setattr(PluginManager, "instance", lambda: manager)

    def layers(path: Path) -> dict[str, tuple[np.ndarray, dict[str, Any], str]]:
        found = read([str(path)], stack=False)
        named = {each[1]["name"]: each for each in found}
        assert len(named) == len(found)
        return named

    yield layers
    manager.unregister("ps4rig")


def test_npe2_accepts_the_manifest_and_what_it_names() -> None:
    result = CliRunner().invoke(app, ["validate", str(MANIFEST), "--imports"])
    assert result.exit_code == 0, result.output


def test_the_installed_package_points_to_the_manifest() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    manifest = PluginManifest.from_file(MANIFEST)
    assert project["entry-points"]["napari.manifest"] == {"ps4rig": "capture:napari.yaml"}
    assert manifest.name == project["name"]
    assert not any("napari" in each or "npe2" in each for each in project["dependencies"])


def test_a_set_opens_as_one_layer_for_each_page(opened: Opened, tmp_path: Path) -> None:
    stored = CapturedSet.load(SET)
    mask = np.zeros(stored.images.shape[1:], np.bool_)
    mask[3:9, 2:] = True
    update = {
        "mask_file": "mask.png",
        "mm_per_px": MM_PER_PX,
        "pixels_sha256": pixels_sha256(stored.images, stored.ambient, mask),
    }
    captured = replace(stored, metadata=stored.metadata.model_copy(update=update), mask=mask)
    captured.save(tmp_path / "a.ome.tif")
    layers = opened(tmp_path / "a.ome.tif")
    lights = ["tilt 0 deg", "tilt 90 deg", "tilt 180 deg", "tilt 270 deg"]
    assert list(layers) == [*lights, "ambient", "mask"]
    for name, page in zip(lights, captured.images, strict=True):
        values, about, kind = layers[name]
        np.testing.assert_array_equal(values, page)
        assert (kind, about["contrast_limits"]) == ("image", (0, 4095))
        assert about["scale"] == (MM_PER_PX, MM_PER_PX)
        assert about["units"] == ("mm", "mm")
        assert about["metadata"]["ps4rig"]["specimen"] == "rock-07"
    np.testing.assert_array_equal(layers["ambient"][0], captured.ambient)
    np.testing.assert_array_equal(layers["mask"][0], mask)
    assert layers["mask"][2] == "labels"
    assert [name for name, (_, about, _) in layers.items() if about["visible"]] == lights[:1]


@pytest.mark.parametrize("path", sorted(SETS.glob("*.ome.tif")), ids=lambda path: path.name)
def test_sets_of_old_schemas_open_without_a_scale(opened: Opened, path: Path) -> None:
    layers = opened(path)
    assert np.array_equal(np.stack([layer[0] for layer in layers.values()]), tifffile.imread(path))
    assert not any({"scale", "units"} & layer[1].keys() for layer in layers.values())


@pytest.mark.parametrize("mm_per_px", [None, MM_PER_PX])
def test_a_folder_of_maps_opens_as_layers(
    opened: Opened, tmp_path: Path, mm_per_px: float | None
) -> None:
    captured = CapturedSet.load(SET)
    surface = captured.solve()
    write_maps(captured, surface, tmp_path, mm_per_px=mm_per_px)
    tifffile.imwrite(tmp_path / "of-someone-else.tif", np.zeros((4, 5), np.uint8))
    layers = opened(tmp_path)
    files = {path.stem for path in tmp_path.glob("*.tif")} - {"normals", "of-someone-else"}
    assert set(layers) == files | {"normals x", "normals y", "normals z"}
    for name, (values, about, kind) in layers.items():
        assert values.shape == surface.shape
        assert about.get("scale") == (None if mm_per_px is None else (mm_per_px, mm_per_px))
        assert about.get("units") == (None if mm_per_px is None else ("mm", "mm"))
        assert (kind == "labels") == (name in {"valid", "specular"})
    np.testing.assert_array_equal(layers["p"][0], surface.p)
    np.testing.assert_array_equal(layers["normals z"][0], surface.normals[..., 2])
    np.testing.assert_array_equal(layers["valid"][0], surface.valid)
    assert layers["height"][1]["metadata"]["ps4rig"]["relative"] == (mm_per_px is None)


def test_other_files_are_left_to_other_readers(tmp_path: Path) -> None:
    other, text, maps = tmp_path / "a.ome.tif", tmp_path / "b.ome.tif", tmp_path / "maps"
    tifffile.imwrite(other, np.zeros((3, 4, 5), np.uint16), ome=True)
    text.write_text("not a TIFF")
    maps.mkdir()
    tifffile.imwrite(maps / "p.tif", np.zeros((4, 5), np.float32), description="{}", metadata=None)
    for path in (other, text, maps, tmp_path, tmp_path / "missing.ome.tif"):
        assert get_reader(str(path)) is None
    assert get_reader([str(SET), str(SET)]) is None


def test_reading_a_set_loads_neither_compiler_nor_solver() -> None:
    script = (
        "import sys; from capture.maps.napari_reader import get_reader; "
        f"get_reader({str(SET)!r})({str(SET)!r}); "
        "print(*{'numba', 'scipy', 'cv2', 'napari', 'npe2'} & set(sys.modules))"
    )
    run = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=60, check=True
    )
    assert run.stdout == "\n"
