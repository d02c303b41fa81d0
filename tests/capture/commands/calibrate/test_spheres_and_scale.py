"""``calibrate lights`` and ``calibrate scale`` on the simulated rig, and on files."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from capture.calibration.ps4cal import CalibrationFile
from capture.sets.light_list import load_light_list
from classify import Lighting
from classify.calibration.calibration import CalibratedLights
from classify.lighting import angles_between_deg
from tests.capture.commands.calibrate.simulated_rigs import rig_toml
from tests.sphere_pictures import Picture, scattered_lights

Run = Callable[..., Any]
LIGHTS = scattered_lights(5, 3, 50.0)
SIDE = 200


def lights_of(path: Path) -> CalibratedLights:
    lights = CalibrationFile.read(path).calibration.lights
    assert lights is not None
    return lights


@pytest.fixture(scope="module")
def photographs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Pictures and a mask, named and coded as in published sets."""
    folder = tmp_path_factory.mktemp("chrome")
    picture = Picture(LIGHTS, background="black", room=0.06, bounce=0.03, gamma=2.2, radius=70.0)
    images, mask = picture.images()
    for number, image in enumerate(images):
        cv2.imwrite(str(folder / f"chrome.{number}.png"), cv2.merge([image] * 3))
        cv2.imwrite(str(folder / f"chrome.{number}.jpg"), image)
    cv2.imwrite(str(folder / "chrome.mask.png"), cv2.merge([255 * mask.astype(np.uint8)] * 3))
    return folder


@pytest.mark.parametrize(("kind", "limit_deg"), [("mirror", 0.5), ("matte", 2.0)])
def test_a_sphere_on_the_simulated_rig_gives_its_lights(
    ps4rig: Run, tmp_path: Path, kind: str, limit_deg: float
) -> None:
    cal = tmp_path / "rig.ps4cal"
    toml = rig_toml(tmp_path, SIDE, mm_per_px=0.2, vignetting_percent=20)
    done = ps4rig("calibrate", "lights", "--rig", toml, "--sphere", kind, cal, "--json",
                  "--diameter-mm", 24, "--list", tmp_path / "found.lp")  # fmt: skip
    assert done.exit_code == 0, done.stderr
    found = lights_of(cal)
    true = Lighting.ring().directions
    assert angles_between_deg(found.lighting.directions, true).max() < limit_deg
    assert found.source == f"{kind} sphere"
    scale = CalibrationFile.read(cal).calibration.scale
    assert scale.mm_per_px == pytest.approx(0.2, rel=0.01)
    assert abs(scale.mm_per_px / 0.2 - 1.0) < 3.0 * scale.error
    lights, _ = json.loads(done.stdout)
    error_deg = lights["figures"]["largest_direction_error_deg"]
    assert angles_between_deg(found.lighting.directions, true).max() < 2.0 * error_deg
    listed = load_light_list(tmp_path / "found.lp")
    np.testing.assert_allclose(listed.vectors, found.lighting.directions, atol=1e-8)
    assert bool(listed.intensities) == (kind == "matte")


@pytest.mark.slow
def test_placements_on_a_rig_with_near_lights_give_positions(ps4rig: Run, tmp_path: Path) -> None:
    toml = rig_toml(tmp_path, SIDE, led_distance_px=2 * SIDE, mm_per_px=0.4)
    cal = tmp_path / "rig.ps4cal"
    done = ps4rig("calibrate", "lights", "--rig", toml, "--sphere", "matte", cal, "--placements", 5,
                  "--diameter-mm", 24)  # fmt: skip
    assert done.exit_code == 0, done.stderr
    positions = lights_of(cal).lighting.positions_px
    assert positions is not None
    true = 2 * SIDE * Lighting.ring().directions
    assert (np.linalg.norm(positions - true, axis=1) / (2 * SIDE)).max() < 0.1


def test_photographs_as_a_shell_gives_them_and_their_mask(
    ps4rig: Run, photographs: Path, tmp_path: Path
) -> None:
    mask = photographs / "chrome.mask.png"
    images, cal = sorted(photographs.glob("*.png")), tmp_path / "out.ps4cal"
    assert mask in images
    done = ps4rig("calibrate", "lights", "--from", *images, "--mask", mask, "--lights", 5,
                  cal, "--sphere", "mirror", "--list", tmp_path / "l.json")  # fmt: skip
    assert done.exit_code == 0, done.stderr
    found = lights_of(cal)
    assert angles_between_deg(found.lighting.directions, LIGHTS).max() < 0.5
    assert "degrees" in done.stdout
    others = [Path(f"owl{k}.png") for k in range(5)]
    listed = load_light_list(tmp_path / "l.json").lighting_for(others)
    np.testing.assert_allclose(listed.directions, found.lighting.directions, atol=1e-8)


@pytest.mark.slow
def test_a_jpeg_of_a_mirror_needs_no_gamma(ps4rig: Run, photographs: Path, tmp_path: Path) -> None:
    images = sorted(photographs.glob("*.jpg"))
    cal = tmp_path / "out.ps4cal"
    done = ps4rig("calibrate", "lights", cal, "--from", *images, "--sphere", "mirror")
    assert done.exit_code == 0, done.stderr
    found = lights_of(cal)
    off = angles_between_deg(found.lighting.directions, LIGHTS)
    assert (off < 2.5 * found.direction_errors_deg).all()
    done = ps4rig("calibrate", "lights", cal, "--from", *images, "--sphere", "matte")
    assert done.exit_code == 2
    assert "--gamma" in done.stderr


@pytest.mark.parametrize(
    ("given", "cause"),
    [
        (["--from", "chrome.0.png", "chrome.1.png", "--lights", "5"], "2 photographs"),
        (["--from", "chrome.0.png", "--rig", "sim"], "--rig RIG"),
        (["--from", "chrome.0.png", "--mask", "chrome.1.png", "--mask", "chrome.2.png"], "masks"),
        (["--from", "chrome.0.png", "other.ps4cal"], "2 files NAME.ps4cal"),
        (["--rig", "sim", "--lights", "4"], "for photographs"),
        (["--rig", "missing.toml", "--list", "lights.txt"], ".lp or .json"),
        (["--from", "missing.png"], "missing.png"),
    ],
)
def test_wrong_options_are_named(
    ps4rig: Run, photographs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    given: list[str], cause: str,
) -> None:  # fmt: skip
    monkeypatch.chdir(photographs)
    cal = tmp_path / "out.ps4cal"
    done = ps4rig("calibrate", "lights", *given, cal, "--sphere", "mirror")
    assert done.exit_code == 2
    assert cause in done.stderr
    assert not cal.exists()


def test_no_list_of_lights_is_written_where_the_calibration_is_refused(
    ps4rig: Run, tmp_path: Path
) -> None:
    cal, lights = tmp_path / "rig.ps4cal", tmp_path / "lights.json"
    toml = rig_toml(tmp_path, SIDE)
    assert ps4rig("calibrate", "dark", cal, "--rig", toml).exit_code == 0
    toml.write_text(f"name = 'bench two'\n{toml.read_text()}")
    sphere = ("--sphere", "mirror", "--list", lights)
    done = ps4rig("calibrate", "lights", cal, "--rig", toml, *sphere)
    assert done.exit_code == 2
    assert "is of another rig" in done.stderr
    assert not lights.exists()


def test_a_checkerboard_on_the_simulated_rig_gives_the_scale(ps4rig: Run, tmp_path: Path) -> None:
    cal = tmp_path / "rig.ps4cal"
    toml = rig_toml(tmp_path, SIDE, mm_per_px=0.3)
    board = ("--checkerboard", "9x6", "--square-mm", 5)
    done = ps4rig("calibrate", "scale", "--rig", toml, cal, *board, "--json")
    assert done.exit_code == 0, done.stderr
    scale = CalibrationFile.read(cal).calibration.scale
    assert scale.mm_per_px == pytest.approx(0.3, rel=2e-3)
    assert scale.distortion is None
    captured = tmp_path / "board.ome.tif"
    done = ps4rig("capture", "--rig", toml, "--surface", "checkerboard", captured)
    assert done.exit_code == 0, done.stderr
    done = ps4rig("calibrate", "scale", "--from", captured, cal, *board)
    assert done.exit_code == 0, done.stderr
    assert "replaced" in done.stdout
    done = ps4rig("calibrate", "scale", "--from", captured, cal, "--checkerboard", "10x7",
                  "--square-mm", 5)  # fmt: skip
    assert done.exit_code == 1
    assert "count corners" in done.stderr
    done = ps4rig("calibrate", "scale", "--from", captured, cal, "--checkerboard", "nine",
                  "--square-mm", 5)  # fmt: skip
    assert done.exit_code == 2


@pytest.mark.slow
def test_a_good_scale_is_not_replaced_by_a_mistyped_or_a_worse_one(
    ps4rig: Run, refused: Callable[..., str], tmp_path: Path
) -> None:
    cal, toml = tmp_path / "rig.ps4cal", rig_toml(tmp_path, SIDE, mm_per_px=0.3)
    board = ("calibrate", "scale", "--rig", toml, cal, "--checkerboard", "9x6", "--square-mm")
    assert ps4rig(*board, 5).exit_code == 0
    known = CalibrationFile.read(cal)
    ball = tmp_path / "ball.ome.tif"
    sphere = ("calibrate", "lights", "--from", ball, cal, "--sphere", "matte", "--diameter-mm")
    surface = ("--surface", "matte_sphere", "--target")
    assert ps4rig("capture", "--rig", toml, *surface, ball).exit_code == 0
    message = refused(*sphere, 11, status=1)
    assert f"{cal}: scale: " in message
    assert " instead of 0.29" in message
    assert CalibrationFile.read(cal).hash == known.hash
    done = ps4rig(*sphere, 20)
    assert "scale of" in done.stdout
    assert "kept, because" in done.stdout
    both = CalibrationFile.read(cal)
    assert both.calibration.scale is not None
    assert both.calibration.lights is not None
    assert both.records["scale"] == known.records["scale"]
    # The true size of the squares cannot be mistyped on a simulated rig, but that of a set can.
    picture = tmp_path / "board.ome.tif"
    done = ps4rig("capture", "--rig", toml, "--surface", "checkerboard", "--target", picture)
    assert done.exit_code == 0, done.stderr
    typed = ("calibrate", "scale", "--from", picture, cal, "--checkerboard", "9x6", "--square-mm")
    assert " instead of 0.29" in refused(*typed, 50, status=1)
    assert ps4rig(*typed, 50, "--replace").exit_code == 0
    assert CalibrationFile.read(cal).calibration.mm_per_px == pytest.approx(3.0, rel=0.01)


@pytest.mark.parametrize(
    "command",
    [("lights", "--sphere", "mirror"), ("scale", "--checkerboard", "9x6", "--square-mm", 5)],
)
def test_placements_are_for_a_rig(
    refused: Callable[..., str], tmp_path: Path, command: tuple[object, ...]
) -> None:
    picture = tmp_path / "a.png"
    cv2.imwrite(str(picture), np.zeros((64, 64), np.uint8))
    name, *options = command
    message = refused(
        "calibrate", name, "--from", picture, *options, "--placements", 3, tmp_path / "a.ps4cal"
    )
    assert message.startswith("--placements")
