"""The maps of a solved set as files."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import tifffile

from capture import CapturedSet
from capture.maps import write_maps
from classify.errors import InputError

FLOAT_MAPS = {"p", "q", "albedo", "normals", "height", "residual"}
PICTURES = {"shadow", "valid", "preview"}


@pytest.fixture(scope="module")
def captured(sets: Path) -> CapturedSet:
    return CapturedSet.load(sets / "rock-001.ome.tif")


def test_maps_are_float32_tiffs_of_exactly_what_was_solved(
    captured: CapturedSet, tmp_path: Path
) -> None:
    surface = captured.solve()
    paths = write_maps(captured, surface, tmp_path / "new" / "maps")
    assert {path.name for path in paths} == {
        *(f"{name}.tif" for name in FLOAT_MAPS), *(f"{name}.png" for name in PICTURES),
    }  # fmt: skip
    read = {path.stem: tifffile.imread(path) for path in paths if path.suffix == ".tif"}
    assert all(values.dtype == np.float32 for values in read.values())
    for name in ("p", "q", "albedo", "normals", "residual"):
        np.testing.assert_array_equal(read[name], getattr(surface, name))
    assert read["height"].shape == surface.shape
    assert abs(float(read["height"].mean())) < 1e-3
    np.testing.assert_allclose(np.linalg.norm(read["normals"], axis=2), 1.0, atol=1e-5)


def test_the_height_rises_along_p_and_up_along_q(
    made_set: Callable[..., CapturedSet], tmp_path: Path
) -> None:
    """A plane that rises to the right and upwards: height grows with x and falls with the row."""
    set_ = made_set(np.full((4, 24, 24), 1000, np.uint16))
    normal = np.array([-0.2, -0.1, 1.0]) / np.sqrt(1.05)
    levels = np.rint(40_000 * set_.lighting.directions @ normal).astype(np.uint16)
    tilted = made_set(np.tile(levels[:, None, None], (1, 24, 24)))
    write_maps(tilted, tilted.solve(), tmp_path)
    height = tifffile.imread(tmp_path / "height.tif")
    np.testing.assert_allclose(np.diff(height, axis=1), 0.2, atol=2e-3)
    np.testing.assert_allclose(np.diff(height, axis=0), -0.1, atol=2e-3)


def test_pictures_can_be_looked_at(captured: CapturedSet, tmp_path: Path) -> None:
    surface = captured.solve()
    write_maps(captured, surface, tmp_path)
    valid = cv2.imread(str(tmp_path / "valid.png"), cv2.IMREAD_GRAYSCALE)
    np.testing.assert_array_equal(valid, surface.valid * np.uint8(255))
    shadow = cv2.imread(str(tmp_path / "shadow.png"))
    assert shadow.shape == (*surface.shape, 3)
    assert len(np.unique(shadow.reshape(-1, 3), axis=0)) == len(np.unique(surface.shadow_count))
    assert min(cv2.imread(str(tmp_path / "preview.png")).shape[:2]) > 300


@pytest.mark.parametrize("shape", [(1, 1), (3, 200), (200, 3)])
def test_images_of_any_shape_have_maps(
    made_set: Callable[..., CapturedSet], tmp_path: Path, shape: tuple[int, int]
) -> None:
    set_ = made_set(np.full((4, *shape), 2000, np.uint16))
    assert len(write_maps(set_, set_.solve(), tmp_path)) == 9


def test_a_file_in_the_place_of_the_folder_stays(captured: CapturedSet, tmp_path: Path) -> None:
    file: Any = tmp_path / "maps"
    file.write_text("mine")
    with pytest.raises(InputError, match="maps: cannot be made: File exists"):
        write_maps(captured, captured.solve(), file)
    assert file.read_text() == "mine"
