"""The command import, and damaged files."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from capture import CalibrationFile, CapturedSet
from capture.calibration.ps4cal import PartRecord
from capture.maps.map_tiff import read_description
from classify.calibration.calibration import Scale

Command = Callable[..., Any]
Refused = Callable[..., str]


@pytest.fixture
def photographs(tmp_path: Path) -> list[Path]:
    paths = [tmp_path / f"image{light}.png" for light in range(4)]
    for light, path in enumerate(paths):
        cv2.imwrite(str(path), np.full((20, 30), 100 + light, np.uint8))
    return paths


def test_photographs_become_a_set(ps4rig: Command, photographs: list[Path], tmp_path: Path) -> None:
    out = tmp_path / "a.ome.tif"
    result = ps4rig("import", *photographs, "--slant", 40, "--label", "oak", "--json", out)
    answer = json.loads(result.stdout)
    (warning,) = answer.pop("warnings")
    assert "--gamma" in warning
    about = {"lights": 4, "bits": 8, "gamma": "linear", "gamma_source": "assumed"}
    assert answer == {"set": str(out), **about}
    captured = CapturedSet.load(out)
    assert captured.lighting.tilts_deg.tolist() == [0.0, 90.0, 180.0, 270.0]
    assert captured.lighting.slants_deg.tolist() == [40.0] * 4
    assert [int(image[0, 0]) for image in captured.images] == [100, 101, 102, 103]
    assert not captured.metadata.simulated


def test_a_known_length_of_a_pixel_is_the_scale_of_the_maps(
    ps4rig: Command, refused: Refused, photographs: list[Path], tmp_path: Path
) -> None:
    out, maps = tmp_path / "a.ome.tif", tmp_path / "maps"
    arguments = ("import", *photographs, "--slant", 40, "--mm-per-px", 0.05)
    assert ps4rig(*arguments, out).exit_code == 0
    assert CapturedSet.load(out).metadata.mm_per_px == 0.05
    assert ps4rig("solve", out, "--out", maps).exit_code == 0
    assert read_description(maps / "height.tif")["mm_per_px"] == 0.05
    assert ps4rig("export", out, tmp_path / "a.x3p").exit_code == 0
    scaled = tmp_path / "scale.ps4cal"
    setting = CapturedSet.load(out).setting
    record = PartRecord(setting=setting, quality="Good.", source=("captured",), date="2026-05-01")
    scale = Scale(0.04, 0.001, np.eye(3), None, 0.1)
    CalibrationFile().with_part("scale", scale, record).write(scaled)
    both = (*arguments, "--calibration", scaled, tmp_path / "b.ome.tif")
    assert "--mm-per-px" in refused(*both)


def test_tilts_belong_to_the_photographs_in_their_order(
    ps4rig: Command, photographs: list[Path], tmp_path: Path
) -> None:
    out = tmp_path / "a.ome.tif"
    result = ps4rig("import", *photographs[:3], "--tilts", "10,130,-110", "--slant", 40, out)
    assert result.stdout == f"{out}: 3 lights, response linear (assumed)\n"
    assert CapturedSet.load(out).lighting.tilts_deg.tolist() == [10.0, 130.0, 250.0]


def test_photographs_that_the_command_names_settle_which_namesakes_are_meant(
    ps4rig: Command, refused: Refused, photographs: list[Path], tmp_path: Path
) -> None:
    folder = tmp_path / "lists"
    folder.mkdir()
    (tmp_path / "photos").symlink_to(photographs[0].parent)
    for path in photographs:
        (folder / path.name).write_bytes(path.read_bytes())
    rows = [f"../photos/{p.name} {0.1 * k} {k % 2} 1" for k, p in enumerate(photographs)]
    (folder / "lights.lp").write_text("\n".join(["4", *rows]))
    options = ["--lights", folder / "lights.lp", tmp_path / "a.ome.tif"]
    assert "remove or rename one" in refused("import", *options)
    assert ps4rig("import", *photographs, *options).exit_code == 0


def test_the_known_orientation_of_photographs_is_kept(
    ps4rig: Command, refused: Refused, photographs: list[Path], tmp_path: Path
) -> None:
    out = tmp_path / "a.ome.tif"
    arguments = ("import", *photographs, "--slant", 40, out, "--orientation")
    assert "--orientation nan: give degrees" in refused(*arguments, "nan")
    assert not out.exists()
    assert ps4rig(*arguments, -30).exit_code == 0
    assert CapturedSet.load(out).metadata.orientation_deg == -30.0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ([], "--slant"),
        (["--slant", "45", "--tilts", "0,90,180,west"], "--tilts 0,90,180,west"),
        (["--slant", "45", "--tilts", "0,90,180,2_70"], "--tilts 0,90,180,2_70"),
        (["--slant", "45", "--lights", "x.lp"], "--slant"),
        (["--tilts", "0,90", "--lights", "x.lp"], "--slant and --tilts"),
        (["--slant", "45", "--crop", "1,2,3"], "--crop 1,2,3"),
        (["--slant", "45", "--crop", "9,2,22,5"], "--crop 9,2,22,5"),
        (["--slant", "45", "--bits", "12"], "--bits 12"),
    ],
)
def test_a_wrong_option_of_import_is_one_line(
    refused: Refused, photographs: list[Path], tmp_path: Path, options: list[str], message: str
) -> None:
    assert message in refused("import", *photographs, *options, tmp_path / "a.ome.tif")
    assert not (tmp_path / "a.ome.tif").exists()
