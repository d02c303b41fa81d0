"""`ps4rig compare`: two sets, or two folders of maps."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from capture import CapturedSet, capture_set
from capture.maps.comparison import Comparison, compare, side_of
from capture.maps.map_tiff import read_map, write_values
from rig import RigConfig, open_rig
from rig.set_file import pixels_sha256

Command = Callable[..., Any]
Refused = Callable[..., str]
Capture = Callable[..., Path]


@pytest.fixture
def capture(tmp_path: Path) -> Capture:
    """Capture a simulated part; each set has other noise."""

    def run(
        name: str, surface: str = "sand", *, exposure_ms: float = 20.0, side: int = 128,
        **placed: object,
    ) -> Path:  # fmt: skip
        config = RigConfig().with_changes(
            camera={"width_px": side, "height_px": side, "exposure_ms": exposure_ms},
            simulation={"placement": {"surface": surface, **placed}},
        )
        path = tmp_path / f"{name}.ome.tif"
        with open_rig(config) as rig:
            for _ in range(len(list(tmp_path.glob("*.ome.tif"))) + 1):
                captured = capture_set(rig, label=surface)
        captured.save(path)
        return path

    return run


def compared(first: Path, second: Path) -> Comparison:
    return compare(side_of(first), side_of(second))


@pytest.mark.parametrize(
    "surface",
    ["rock", "sand", *(pytest.param(name, marks=pytest.mark.slow) for name in ("malv", "ogil"))],
)
def test_a_part_that_was_not_moved_is_aligned_and_3_px_are_not(
    capture: Capture, surface: str
) -> None:
    first, again = capture("a", surface), capture("b", surface)
    found = compared(first, again)
    assert found.is_aligned
    for name in ("p", "q", "albedo"):
        assert 0.8 < found.maps[name].rms_in_deviations < 1.1
    assert found.texture is not None
    assert found.texture.distance < 0.1
    assert found.normals_deg is not None
    assert found.normals_deg[0] < 3.0
    assert min(found.maps[name].correlation for name in ("p", "q")) > 0.9
    moved = compared(first, capture("c", surface, shift_px=(3.0, 2.0)))
    assert not moved.is_aligned
    assert min(moved.maps[name].correlation for name in ("p", "q")) < 0.6


def test_the_angle_is_anticlockwise_from_the_first_to_the_second(capture: Capture) -> None:
    first, second = capture("a", rotate_deg=20.0), capture("b", rotate_deg=60.0)
    assert compared(first, second).angle_deg == pytest.approx(40.0, abs=1.5)
    assert compared(second, first).angle_deg == pytest.approx(-40.0, abs=1.5)
    one = compared(first, first)
    for angle_deg, text in ((89.97, "-90.0"), (-90.0, "-90.0"), (-0.04, "0.0"), (None, None)):
        assert replace(one, angle_deg=angle_deg).angle_text == text
    # Rock has no direction.
    rock, elsewhere = capture("c", "rock"), capture("d", "rock", shift_px=(60.0, 9.0))
    assert compared(rock, elsewhere).angle_deg is None


def test_what_differs_is_named_field_by_field(capture: Capture) -> None:
    found = compared(capture("a"), capture("b", exposure_ms=15.0))
    by_field = {field: values for field, *values in found.fields}
    assert by_field.pop("settings.exposure_ms") == [20.0, 15.0]
    assert set(by_field) <= {"set.created_utc"}


def test_frames_of_unlike_sizes_have_a_distance_and_no_pixels(capture: Capture) -> None:
    found = compared(capture("a"), capture("b", side=160))
    assert found.texture is not None
    assert found.maps == {}
    assert found.normals_deg is None
    assert not found.is_aligned
    assert {"settings.width_px", "settings.height_px"} <= {field for field, *_ in found.fields}


def test_the_command_writes_a_page_and_says_the_figures(
    ps4rig: Command, capture: Capture, in_folder: Path
) -> None:
    first, second = capture("a"), capture("b", rotate_deg=40.0)
    result = ps4rig("compare", first, second)
    assert result.exit_code == 0, result.stderr
    said = " ".join(result.stdout.split())
    assert "from A to B" in said
    assert "set.orientation_deg: 0.0 -> 40.0" in said
    assert "the part was moved" in said
    page = (in_folder / "comparison.html").read_text()
    assert page.count("<figure>") == 15
    assert "Simulated." in page
    assert "set.orientation_deg" in page
    assert "<script" not in page
    assert ps4rig("compare", first, second).exit_code == 2  # the page exists
    answer = json.loads(ps4rig("compare", first, second, "--json").stdout)
    assert answer["angle_deg"] == pytest.approx(40.0, abs=1.5)
    assert answer["maps"]["height"]["unit"] == "px, relative"
    assert {"field": "set.orientation_deg", "a": 0.0, "b": 40.0} in answer["differences"]
    assert [path.name for path in in_folder.iterdir()] == ["comparison.html"]


def test_folders_of_maps_are_compared_as_their_sets_are(
    ps4rig: Command, capture: Capture, tmp_path: Path
) -> None:
    sets = [capture("a"), capture("b", exposure_ms=15.0)]
    folders = [tmp_path / f"maps-{path.stem}" for path in sets]
    for path, folder in zip(sets, folders, strict=True):
        assert ps4rig("solve", path, "--out", folder).exit_code == 0
    of_sets, of_maps = compared(*sets), compared(*folders)
    assert of_maps.is_aligned
    assert of_maps.maps["p"].rms == pytest.approx(of_sets.maps["p"].rms, rel=1e-3)
    assert of_maps.maps["height"].unit == "px, relative"
    assert of_maps.texture is not None
    assert of_maps.texture.distance < 0.1
    assert [field for field, *_ in of_maps.fields] == ["set.pixels_sha256"]
    # A set and a folder are compared too.
    assert compared(sets[0], folders[1]).is_aligned


def test_pixels_without_a_slope_are_compared_in_no_map(
    ps4rig: Command, refused: Refused, capture: Capture, tmp_path: Path
) -> None:
    """A set and its maps are equal, also maps with 0 where earlier versions had no slope."""
    whole = CapturedSet.load(capture("a"))
    mask = np.zeros(whole.images.shape[1:], np.bool_)
    mask[20:-20, 30:-10] = True
    about = whole.metadata.model_copy(
        update={"mask_file": "m.png",
                "pixels_sha256": pixels_sha256(whole.images, whole.ambient, mask)}
    )  # fmt: skip
    path, maps = tmp_path / "masked.ome.tif", tmp_path / "maps"
    replace(whole, metadata=about, mask=mask).save(path)
    assert ps4rig("solve", path, "--out", maps).exit_code == 0
    for name in ("p", "height", "p"):
        found = compared(path, maps)
        assert {each.largest for each in found.maps.values()} == {0.0}
        assert found.texture is not None
        for side in (found.first, found.second):
            assert all(np.isnan(values[~mask]).all() for values, _ in side.maps.values())
        assert ps4rig("compare", path, maps, "--out", tmp_path / "c.html", "--force").exit_code == 0
        values, description = read_map(maps / f"{name}.tif")
        write_values(maps / f"{name}.tif", np.nan_to_num(values), description, None)
    values[mask.nonzero()[0][0], mask.nonzero()[1][0]] = np.nan
    write_values(maps / "p.tif", values, description, None)
    assert f"{maps / 'p.tif'}: " in refused("compare", path, maps, "--json")


def test_inputs_that_cannot_be_compared_are_refused_by_name(
    refused: Refused, ps4rig: Command, capture: Capture, tmp_path: Path
) -> None:
    first, empty, maps = capture("a"), tmp_path / "empty", tmp_path / "maps"
    empty.mkdir()
    assert f"{empty}: holds no maps" in refused("compare", first, empty, "--json")
    assert "b.ome.tif: " in refused("compare", first, tmp_path / "b.ome.tif", "--json")
    assert "give a captured set" in refused("compare", tmp_path / "b.png", first, "--json")
    assert "must end in .html" in refused("compare", first, first, "--out", tmp_path / "a.pdf")
    assert ps4rig("solve", first, "--out", maps).exit_code == 0
    whole = (maps / "q.tif").read_bytes()
    (maps / "q.tif").write_bytes(whole[:500])
    assert f"{maps / 'q.tif'}: " in refused("compare", first, maps, "--json")
    (maps / "q.tif").write_bytes(whole)
    (maps / "valid.tif").write_bytes((maps / "normals.tif").read_bytes())
    assert f"{maps / 'valid.tif'}: " in refused("compare", first, maps, "--json")
