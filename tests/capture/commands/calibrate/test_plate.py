"""``calibrate plate`` on the simulated rig, and on sets of sheets and of flat areas of parts."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from capture.calibration.ps4cal import CalibrationFile
from classify import Lighting
from tests.capture.commands.calibrate import simulated_rigs

Run = Callable[..., Any]
SIDE = 128


def rig_toml(folder: Path, distance_px: float | None = 3.0 * SIDE, **more: object) -> Path:
    """A simulated rig with near, unequal LEDs, ambient light and vignetting."""
    values: dict[str, object] = {"ambient": 0.03, "vignetting_percent": 20}
    values |= {"led_levels": [1.0, 0.9, 1.05, 0.95]} | more
    if distance_px is not None:
        values["led_distance_px"] = distance_px
    return simulated_rigs.rig_toml(folder, SIDE, **values)


def answer(ps4rig: Run, *arguments: object) -> list[dict[str, Any]]:
    done = ps4rig("calibrate", "plate", *arguments, "--json")
    assert done.exit_code == 0, (done.stderr, done.exception)
    parts = json.loads(done.stdout)
    return parts if isinstance(parts, list) else [parts]


def captured(ps4rig: Run, folder: Path, surface: str, *rotations_deg: float) -> list[Path]:
    """Sets of a surface under the rig of `folder`."""
    rotations = [part for each in rotations_deg for part in ("--rotate", each)]
    output = folder / f"{surface}.ome.tif"
    done = ps4rig("capture", "--rig", folder / "rig.toml", "--surface", surface, *rotations, output)
    assert done.exit_code == 0, done.stderr
    return [output] if len(rotations_deg) == 1 else sorted(folder.glob(f"{surface}-*.ome.tif"))


def test_a_rig_or_sets_are_needed_and_not_both(ps4rig: Run, tmp_path: Path) -> None:
    for given in ((), ("--rig", "sim", "--from", tmp_path)):
        done = ps4rig("calibrate", "plate", tmp_path / "rig.ps4cal", *given)
        assert done.exit_code == 2
        assert "--rig RIG to capture the target, or --from SET" in done.stderr


def test_a_rig_gets_its_flat_field_and_positions(ps4rig: Run, tmp_path: Path) -> None:
    toml, path = rig_toml(tmp_path), tmp_path / "rig.ps4cal"
    field, lights = answer(ps4rig, "--rig", toml, path)
    assert (field["part"], lights["part"]) == ("flat_field", "lights")
    assert field["figures"]["placements"] == 2
    assert field["figures"]["error_percent"] < 0.3
    assert lights["figures"]["distance_error_percent"] < 3.0
    kept = CalibrationFile.read(path).calibration.lights
    positions_px = kept.lighting.positions_px
    assert positions_px is not None
    true = 3.0 * SIDE * Lighting.ring(45.0).directions
    distances = np.linalg.norm(positions_px, axis=1) / (3.0 * SIDE)
    np.testing.assert_allclose(distances, 1.0, atol=0.03)
    assert kept.lighting.within(1.5, Lighting(true))


@pytest.mark.slow
def test_positions_of_an_older_sheet_do_not_outlast_distant_lights(
    ps4rig: Run, refused: Callable[..., str], tmp_path: Path
) -> None:
    path = tmp_path / "rig.ps4cal"
    rig_toml(tmp_path)
    answer(ps4rig, "--from", *captured(ps4rig, tmp_path, "plate", 0), path)
    assert CalibrationFile.read(path).calibration.lights is not None
    (tmp_path / "distant").mkdir()
    rig_toml(tmp_path / "distant", None)
    distant = captured(ps4rig, tmp_path / "distant", "plate", 0)
    plate = ("calibrate", "plate", "--from", *distant, path)
    assert "flat field: light 0" in refused(*plate, status=1)
    done = ps4rig(*plate, "--replace")
    assert done.exit_code == 0, done.stderr
    assert "LED positions" in done.stderr
    assert "too far away" in done.stderr
    kept = CalibrationFile.read(path).calibration
    assert kept.lights is None
    assert kept.flat_field is not None


def test_sets_of_a_sheet_serve_as_well_as_the_rig(ps4rig: Run, tmp_path: Path) -> None:
    rig_toml(tmp_path, 2.5 * SIDE)
    sets = captured(ps4rig, tmp_path, "plate", 0, 180)
    once = answer(ps4rig, "--from", sets[0], tmp_path / "once.ps4cal")
    twice = answer(ps4rig, "--from", sets[0], "--from", sets[1], tmp_path / "twice.ps4cal")
    assert "one placement" in once[0]["warnings"][0]
    assert twice[0]["warnings"] == []
    assert twice[0]["source"] == [each.name for each in sets]
    errors_deg = [each[1]["figures"]["direction_error_deg"] for each in (once, twice)]
    assert errors_deg[0] > 1.0 > errors_deg[1]


def test_sets_of_one_sheet_have_one_full_scale(
    ps4rig: Run, refused: Callable[..., str], tmp_path: Path
) -> None:
    toml = rig_toml(tmp_path)
    for average in (1, 2):
        output = tmp_path / f"{average}.ome.tif"
        arguments = ("--surface", "plate", "--average", average)
        done = ps4rig("capture", "--rig", toml, *arguments, output)
        assert done.exit_code == 0, done.stderr
    given = [part for each in (1, 2) for part in ("--from", tmp_path / f"{each}.ome.tif")]
    message = refused("calibrate", "plate", *given, tmp_path / "rig.ps4cal")
    assert message.startswith("set 2 of the sheet")


def test_flat_areas_of_a_part_serve_with_a_mask(ps4rig: Run, tmp_path: Path) -> None:
    toml, path = rig_toml(tmp_path), tmp_path / "rig.ps4cal"
    (sheet,) = captured(ps4rig, tmp_path, "plate", 0)
    mask = np.full((SIDE, SIDE), 255, np.uint8)
    mask[:, 40:60] = 0
    cv2.imwrite(str(tmp_path / "mask.png"), mask)
    parts = answer(ps4rig, "--from", sheet, "--mask", tmp_path / "mask.png", path)
    assert parts[0]["figures"]["error_percent"] < 0.5
    done = ps4rig("calibrate", "plate", "--rig", toml, path, "--mask", tmp_path / "mask.png")
    assert done.exit_code == 2
    assert "--mask is for" in done.stderr


def test_sets_of_another_setting_are_refused(
    ps4rig: Run, refused: Callable[..., str], tmp_path: Path
) -> None:
    folders = [tmp_path / name for name in ("a", "b")]
    for folder, tilts in zip(folders, ("0, 90, 180, 270", "90, 0, 180, 270"), strict=True):
        folder.mkdir()
        toml = rig_toml(folder)
        text = toml.read_text().replace("[camera]", f"tilts_deg = [{tilts}]\n[camera]")
        toml.write_text(text)
    first, second = (captured(ps4rig, each, "plate", 0)[0] for each in folders)
    both = ("--from", first, "--from", second)
    message = refused("calibrate", "plate", *both, tmp_path / "rig.ps4cal")
    assert message.startswith("set 2 of the sheet")
