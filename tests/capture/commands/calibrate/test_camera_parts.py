"""``calibrate dark`` and ``calibrate response`` on the simulated rig, and on files."""

import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from capture import CapturedSet, capture_set
from capture.calibration.ps4cal import CalibrationFile
from rig import open_rig
from rig.simulation.sensor import SensorModel
from tests.capture.commands.calibrate import simulated_rigs

Run = Callable[..., Any]
SIDE = 128
LEVELS = np.linspace(0.0, 1.0, 257)


def rig_toml(folder: Path, bits: int = 12, **simulation: object) -> Path:
    """A simulated rig with near LEDs, ambient light and vignetting."""
    values = {"led_distance_px": 5 * SIDE, "ambient": 0.03, "vignetting_percent": 20} | simulation
    return simulated_rigs.rig_toml(folder, SIDE, bits, **values)


def calibrated(ps4rig: Run, folder: Path, *commands: str, **rig: Any) -> list[Any]:
    """Run commands of `calibrate` on a rig, one file for all; return their JSON."""
    toml, answers = rig_toml(folder, **rig), []
    for command in commands:
        done = ps4rig("calibrate", command, "--rig", toml, folder / "rig.ps4cal", "--json")
        assert done.exit_code == 0, (done.stderr, done.exception)
        answers.append(json.loads(done.stdout))
    return answers


@pytest.mark.parametrize("bits", [8, 10, 12])
def test_the_noise_of_the_simulated_sensor_is_found(ps4rig: Run, tmp_path: Path, bits: int) -> None:
    dark, (response, noise) = calibrated(ps4rig, tmp_path, "dark", "response", bits=bits)
    sensor = SensorModel(bits)
    assert dark["figures"]["offset_dn"] == pytest.approx(sensor.black_level_dn, abs=0.05)
    assert dark["figures"]["hot_pixels"] == 0
    assert "linear" in response["quality"]
    assert "0.00%" not in response["quality"]
    found = noise["figures"]
    gain_error = abs(found["gain_e_per_dn"] / sensor.gain_e_per_dn - 1.0)
    assert gain_error < 3.0 * found["gain_error_share"] < 0.03
    # In the dark of 12 bits the noise shows; rounding hides it at 8 bits, where the line gives it.
    allowed = 3.0 * found.get("read_noise_error_dn", 0.01 * sensor.read_noise_dn)
    assert abs(found["read_noise_dn"] - sensor.read_noise_dn) < allowed
    kept = CalibrationFile.read(tmp_path / "rig.ps4cal").calibration
    assert kept.response.linear
    assert kept.dark.ambient is not None


def test_a_second_dark_exposure_is_added(
    ps4rig: Run, refused: Callable[..., str], tmp_path: Path
) -> None:
    toml, path = rig_toml(tmp_path, hot_pixels=20), tmp_path / "rig.ps4cal"

    def exposed(exposure_ms: float) -> Path:
        changed = tmp_path / f"{exposure_ms}.toml"
        changed.write_text(toml.read_text().replace("bits", f"exposure_ms = {exposure_ms}\nbits"))
        return changed

    for exposure_ms in (20.0, 5.0):
        done = ps4rig("calibrate", "dark", "--rig", exposed(exposure_ms), path, "--json")
        answer = json.loads(done.stdout)
    kept = CalibrationFile.read(path)
    assert kept.calibration.dark.exposures_ms == (5.0, 20.0)
    assert len(kept.calibration.dark.at(10.0).hot_pixels) == 20
    figures = answer["figures"]
    assert (figures["exposures"], figures["shortest_ms"], figures["longest_ms"]) == (2, 5, 20)
    assert abs(figures["dark_current_dn_per_s"]) < 5.0
    capture = ("capture", "--calibration", path, "--rig")
    out = tmp_path / "a.ome.tif"
    assert ps4rig(*capture, exposed(15.0), out).exit_code == 0
    assert CapturedSet.load(out).solve().valid.any()
    line = refused(*capture, exposed(25.0), tmp_path / "b.ome.tif")
    assert "exposure 25 ms, dark frames" in line


def test_sets_of_several_exposures_show_the_response(ps4rig: Run, tmp_path: Path) -> None:
    sets = []
    with open_rig(rig_toml(tmp_path, response_gamma=1.8)) as rig:
        for number, exposure_ms in enumerate((1.5, 3.0, 6.0, 10.0, 15.0, 20.0, 28.0)):
            rig.camera.set_exposure(exposure_ms)
            sets += ["--from", tmp_path / f"{number}.ome.tif"]
            capture_set(rig, is_target=True).save(sets[-1])
    done = ps4rig("calibrate", "response", tmp_path / "rig.ps4cal", *sets)
    assert done.exit_code == 0, done.stderr
    assert "not linear" in done.stdout
    kept = CalibrationFile.read(tmp_path / "rig.ps4cal")
    assert np.abs(kept.calibration.response.curve - LEVELS**1.8).max() < 0.005
    assert kept.records["response"].source == tuple(f"{number}.ome.tif" for number in range(7))


def test_sets_that_cannot_show_a_response_are_refused(
    ps4rig: Run, refused: Callable[..., str], made_set: Callable[..., CapturedSet], tmp_path: Path
) -> None:
    photographs, single = tmp_path / "photographs.ome.tif", tmp_path / "one.ome.tif"
    made_set(np.full((4, 64, 64), 100, np.uint16)).save(photographs)
    path = tmp_path / "rig.ps4cal"
    message = refused("calibrate", "response", path, "--from", photographs)
    assert "not state its exposure" in message
    assert ps4rig("capture", "--rig", rig_toml(tmp_path), single).exit_code == 0
    message = refused("calibrate", "response", path, "--from", single, status=1)
    assert "1 different exposures" in message
    assert not path.exists()


def ladder_photographs(folder: Path, gamma: float, exposures_s: list[str]) -> Path:
    """JPEGs of a white sheet with fall-off; `exposures_s` are fractions for the EXIF data."""
    rng = np.random.default_rng(1)
    sheet = np.linspace(0.5, 1.0, 96)[:, None] * np.linspace(0.7, 1.0, 128)
    longest = max(true_s(each) for each in exposures_s)
    folder.mkdir()
    for number, exposure in enumerate(exposures_s):
        light = 0.98 * sheet * true_s(exposure) / longest
        light = np.clip(light + 0.004 * rng.standard_normal(light.shape), 0.0, 1.0)
        pixels = np.rint(255 * light ** (1 / gamma)).astype(np.uint8)
        plain = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, 98])[1].tobytes()
        numerator, denominator = map(int, exposure.split("/"))
        exif = b"Exif\0\0II*\0" + struct.pack("<IHHHIII", 8, 1, 0x8769, 4, 1, 26, 0)
        exif += struct.pack("<HHHIIIII", 1, 0x829A, 5, 1, 44, 0, numerator, denominator)
        head = b"\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif
        (folder / f"{number:02}.jpg").write_bytes(plain[:2] + head + plain[2:])
    return folder


def true_s(marked: str) -> float:
    """The exposure of a shutter that is marked with a rounded fraction."""
    return 2.0 ** (round(3 * np.log2(int(marked.split("/")[0]) / int(marked.split("/")[1]))) / 3)


def test_photographs_with_marked_exposures_show_the_response(
    ps4rig: Run, refused: Callable[..., str], tmp_path: Path
) -> None:
    marked = ["1/8", "1/10", "1/13", "1/15", "1/20", "1/30", "1/40", "1/60", "1/125", "1/250"]
    folder, path = ladder_photographs(tmp_path / "sheet", 2.0, marked), tmp_path / "rig.ps4cal"
    command = ("calibrate", "response", path, "--from", folder)
    done = ps4rig(*command, "--gamma", "linear")
    assert done.exit_code == 0, done.stderr
    curve = CalibrationFile.read(path).calibration.response.curve
    assert np.abs(curve - LEVELS**2.0).max() < 0.005
    times_ms = ",".join(f"{1e3 * true_s(each):.6f}" for each in marked)
    done = ps4rig(*command, "--gamma", "linear", "--exposures-ms", times_ms)
    assert done.exit_code == 0, done.stderr
    np.testing.assert_allclose(
        CalibrationFile.read(path).calibration.response.curve, curve, atol=1e-3
    )
    assert "JPEG does not state" in refused(*command)
    assert "for each of 10" in refused(*command, "--exposures-ms", "1,2")
    assert "give numbers" in refused(*command, "--exposures-ms", "1;2")
    cv2.imwrite(str(folder / "99.png"), np.zeros((96, 128), np.uint8))
    assert "99.png: its EXIF data" in refused(*command, "--gamma", "linear")


def dark_photographs(folder: Path, count: int = 4) -> Path:
    rng = np.random.default_rng(1)
    folder.mkdir()
    for number in range(count):
        values = 30 + 2.0 * rng.standard_normal((64, 80))
        values[3, 5] = 200
        cv2.imwrite(str(folder / f"{number}.png"), np.rint(values).astype(np.uint16))
    return folder


def test_photographs_of_the_covered_lens_give_the_dark_part(ps4rig: Run, tmp_path: Path) -> None:
    path, folder = tmp_path / "rig.ps4cal", dark_photographs(tmp_path / "dark")
    done = ps4rig("calibrate", "dark", path, "--from", folder, "--bits", 12, "--json")
    assert done.exit_code == 0, done.stderr
    figures = json.loads(done.stdout)["figures"]
    assert figures["offset_dn"] == pytest.approx(30.0, abs=0.1)
    assert figures["noise_dn"] == pytest.approx(2.02, abs=0.05)
    dark = CalibrationFile.read(path).calibration.dark
    np.testing.assert_array_equal(dark.hot_pixels, [[3, 5]])
    assert dark.full_scale == 4095


@pytest.mark.parametrize(("given", "warns"), [((), True), (("--gamma", "linear"), False)])
def test_a_response_that_photographs_do_not_state_is_a_warning(
    ps4rig: Run, tmp_path: Path, given: tuple[str, ...], warns: bool
) -> None:
    folder = tmp_path / "dark"
    folder.mkdir()
    for number in range(3):
        noise = np.random.default_rng(number).integers(3, 9, (64, 80))
        cv2.imwrite(str(folder / f"{number}.png"), noise.astype(np.uint8))
    done = ps4rig("calibrate", "dark", tmp_path / "rig.ps4cal", "--from", folder, *given)
    assert done.exit_code == 0, done.stderr
    assert ("--gamma srgb" in done.stderr) == warns


def test_a_set_gives_the_depth_of_dark_photographs_and_the_ambient_light(
    ps4rig: Run, made_set: Callable[..., CapturedSet], tmp_path: Path
) -> None:
    path, folder = tmp_path / "rig.ps4cal", dark_photographs(tmp_path / "dark")
    lit, ambient = np.full((4, 64, 80), 900, np.uint16), np.full((64, 80), 50, np.uint16)
    made_set(lit, ambient, bit_depth=12, full_scale=4095).save(tmp_path / "sheet.ome.tif")
    given = ("--from", folder, "--from", tmp_path / "sheet.ome.tif")
    done = ps4rig("calibrate", "dark", path, *given, "--json")
    assert done.exit_code == 0, done.stderr
    figures = json.loads(done.stdout)["figures"]
    assert figures["ambient_dn"] == pytest.approx(20.0, abs=0.1)


def test_photographs_that_cannot_show_the_dark_are_refused(
    refused: Callable[..., str], tmp_path: Path
) -> None:
    path, folder = tmp_path / "rig.ps4cal", dark_photographs(tmp_path / "dark")
    assert "give --bits" in refused("calibrate", "dark", path, "--from", folder)
    assert "one frame of" in refused(
        "calibrate", "dark", path, "--from", folder / "0.png", "--bits", 12
    )
    for number in range(2):
        cv2.imwrite(str(tmp_path / f"{number}.jpg"), np.zeros((64, 64), np.uint8))
    jpegs = ("--from", tmp_path / "0.jpg", "--from", tmp_path / "1.jpg")
    assert "JPEG does not state" in refused("calibrate", "dark", path, *jpegs)
    cv2.imwrite(str(tmp_path / "lit.png"), np.full((64, 64), 128, np.uint8))
    lit = ("--from", tmp_path / "lit.png", "--from", tmp_path / "lit.png")
    lit = (*lit, "--gamma", "linear")
    assert "cover the lens" in refused("calibrate", "dark", path, *lit, status=1)
    assert not path.exists()


def test_a_lens_that_is_not_covered_is_refused_by_the_light_of_an_led(
    ps4rig: Run, refused: Callable[..., str], tmp_path: Path
) -> None:
    # A camera that replays a set stands for a real one, which a person must cover.
    assert ps4rig("capture", "--rig", rig_toml(tmp_path), tmp_path / "a.ome.tif").exit_code == 0
    replay = tmp_path / "replay.toml"
    replay.write_text(
        "[lights]\nport = 'simulated'\n[camera]\nkind = 'replay'\nset_file = 'a.ome.tif'\n"
    )
    path = tmp_path / "rig.ps4cal"
    message = refused("calibrate", "dark", "--rig", replay, path, "--yes", status=1)
    assert "makes the frame brighter" in message
    asked = ps4rig("calibrate", "dark", "--rig", replay, path)
    assert asked.exit_code == 2
    assert "cover the lens" in asked.stderr
    message = refused("calibrate", "response", "--rig", replay, path, "--yes", status=3)
    assert "one exposure only" in message
    assert not path.exists()


def test_levels_that_the_ladder_does_not_reach_are_named(ps4rig: Run, tmp_path: Path) -> None:
    toml = rig_toml(tmp_path, bits=8, response_gamma=2.2)
    fast = "[camera]\nframe_rate_hz = 80\nexposure_ms = 10\n"
    toml.write_text(toml.read_text().replace("[camera]\n", fast))
    done = ps4rig("calibrate", "response", "--rig", toml, tmp_path / "rig.ps4cal")
    assert done.exit_code == 0, done.stderr
    assert "extrapolated" in done.stderr
    assert "needs a linear camera" in done.stderr
    kept = CalibrationFile.read(tmp_path / "rig.ps4cal").calibration
    assert kept.noise is None
    curve = kept.response.curve
    # The true curve up to its scale, which the highest level of the ladder determines.
    seen = LEVELS < 0.6
    np.testing.assert_allclose(
        curve[seen] / curve[seen][-1], (LEVELS[seen] / LEVELS[seen][-1]) ** 2.2, atol=0.01
    )


@pytest.mark.slow
def test_averages_and_single_frames_of_sets_are_of_one_camera(ps4rig: Run, tmp_path: Path) -> None:
    sets = []
    with open_rig(rig_toml(tmp_path)) as rig:
        for exposure_ms in (1.5, 3.0, 6.0, 10.0, 15.0, 28.0):
            rig.camera.set_exposure(exposure_ms)
            for average in (1, 1, 2):
                sets += ["--from", tmp_path / f"{len(sets)}.ome.tif"]
                capture_set(rig, average=average).save(sets[-1])
    done = ps4rig("calibrate", "response", tmp_path / "rig.ps4cal", *sets, "--json")
    assert done.exit_code == 0, done.stderr
    response, noise = json.loads(done.stdout)
    sensor = SensorModel(12)
    assert response["figures"]["offset_dn"] == pytest.approx(sensor.black_level_dn, abs=2.0)
    assert noise["figures"]["gain_e_per_dn"] == pytest.approx(sensor.gain_e_per_dn, rel=0.03)
