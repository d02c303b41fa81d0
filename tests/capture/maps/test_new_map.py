"""A new map is a function and a row: then files, page, preview, compare and napari have it."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import tifffile

from capture import CapturedSet
from capture.maps import views
from capture.maps.map_kinds import MAP_KINDS
from capture.maps.napari_reader import get_reader
from capture.maps.views import MapKind, SurfaceMaps

STEEP = 0.3


def slope(maps: SurfaceMaps) -> np.ndarray:
    return np.hypot(maps.surface.p, maps.surface.q)


ROWS = (
    MapKind(
        "slope", "Slopes and height", "slope", "Steepest slope.", slope, views.grey, "1/{length}",
        is_compared=True,
    ),
    MapKind(
        "steep", "Quality", "steep", "Above 0.3.",
        lambda maps: (slope(maps) > STEEP) * np.uint8(255), views.labelled, labels=views.YES_NO,
    ),
)  # fmt: skip


@pytest.fixture
def maps(
    sets: Path, tmp_path: Path, ps4rig: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> Path:
    """The maps of a set with the two new ones."""
    for row in ROWS:
        monkeypatch.setitem(MAP_KINDS, row.name, row)
    ps4rig("solve", sets / "rock-001.ome.tif", "--out", tmp_path / "maps")
    return tmp_path / "maps"


def test_the_files_have_their_values_and_units(maps: Path, sets: Path) -> None:
    surface = CapturedSet.load(sets / "rock-001.ome.tif").solve()
    expected = np.hypot(surface.p, surface.q)
    values = tifffile.imread(maps / "slope.tif")
    np.testing.assert_array_equal(values, np.where(surface.valid, expected, np.nan))
    with tifffile.TiffFile(maps / "slope.tif") as file:
        assert '"unit": "1/px"' in file.pages.first.description
    np.testing.assert_array_equal(tifffile.imread(maps / "steep.tif"), 255 * (expected > STEEP))
    steep = cv2.imread(str(maps / "steep.png"), cv2.IMREAD_GRAYSCALE)
    np.testing.assert_array_equal(steep, 255 * (expected > STEEP))


def test_the_page_and_the_preview_show_them(maps: Path) -> None:
    page = (maps / "index.html").read_text(encoding="utf-8")
    assert 'alt="slope"' in page
    assert "slope.tif" in page
    assert "Steepest slope." in page
    assert 'alt="steep"' in page
    assert "steep.png" in page
    # 4 light images, 4 of the surface, 4 of 5 slopes and heights, 2 curvatures, 2 of 6 of quality.
    assert cv2.imread(str(maps / "preview.png")).shape[0] == 4 * (320 + 24)


def test_napari_shows_them(maps: Path) -> None:
    read = get_reader(str(maps))
    assert read is not None
    layers = {arguments["name"]: kind for _, arguments, kind in read(str(maps))}
    assert (layers["slope"], layers["steep"]) == ("image", "labels")


def test_compare_compares_the_row_that_says_so(
    maps: Path, sets: Path, ps4rig: Callable[..., Any]
) -> None:
    answer = json.loads(ps4rig("compare", maps, sets / "rock-001.ome.tif", "--json").stdout)
    assert {"p", "q", "albedo", "height", "residual", "slope"} == answer["maps"].keys()
    assert answer["maps"]["slope"]["largest"] == pytest.approx(0.0, abs=1e-6)
    assert answer["maps"]["slope"]["unit"] == "1/px"
