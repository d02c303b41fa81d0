"""capture, import, solve, train, classify and evaluate with a calibration."""

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import tifffile

from capture import CapturedSet, capture_set
from capture.base.errors import CalibrationError
from capture.calibration.ps4cal import CalibrationFile
from capture.maps.map_tiff import read_map
from classify.base.errors import InputError
from classify.calibration.calibration import Calibration
from rig import open_rig

RIG = """
calibration = "rig.ps4cal"
[lights]
port = "simulated"
[camera]
width_px = 128
height_px = 128
exposure_ms = 15.0
[simulation]
led_distance_px = 320.0
led_levels = [1.0, 0.9, 1.05, 0.85]
"""


@pytest.fixture(scope="module")
def lab(
    tmp_path_factory: pytest.TempPathFactory,
    near_calibration: CalibrationFile,
    ps4rig: Callable[..., Any],
) -> Path:
    """A folder with a near, unequal rig, its calibration, and sets of two textures; read-only."""
    folder = tmp_path_factory.mktemp("lab")
    (folder / "rig.toml").write_text(RIG)
    near_calibration.write(folder / "rig.ps4cal")
    (folder / "sets").mkdir()
    for name in ("rock", "malv"):
        done = ps4rig(
            "capture", "--rig", folder / "rig.toml", "--surface", name, "--label", name,
            "--rotate", 0, "--rotate", 40, folder / "sets" / f"{name}.ome.tif",
        )  # fmt: skip
        assert done.exit_code == 0, done.stderr
    return folder


def solved(ps4rig: Callable[..., Any], out: Path, *arguments: object) -> dict[str, Any]:
    done = ps4rig("solve", *arguments, "--out", out, "--json")
    assert done.exit_code == 0, done.stderr
    return json.loads(done.stdout)


def test_solve_uses_it_says_both_residuals_and_leaves_it_out_with_raw(
    lab: Path, tmp_path: Path, ps4rig: Callable[..., Any]
) -> None:
    path = lab / "sets" / "rock-001.ome.tif"
    calibrated = solved(ps4rig, tmp_path / "calibrated", path)
    raw = solved(ps4rig, tmp_path / "raw", path, "--raw")
    assert "sets/calibration/rig-" in calibrated["calibration"]
    assert calibrated["residual"] < 0.5 * calibrated["raw_residual"]
    assert raw["residual"] == calibrated["raw_residual"]
    assert (raw["calibration"], raw["raw_residual"]) == (None, None)
    for name, cal in (
        ("calibrated", CalibrationFile.read(calibrated["calibration"]).hash),
        ("raw", None),
    ):
        roughness = json.loads((tmp_path / name / "roughness.json").read_text())
        for about in (roughness, read_map(tmp_path / name / "height.tif")[1]):
            assert about["calibration_sha256"] == cal
            assert (about["calibration"] is None) == (cal is None)
    page = (tmp_path / "calibrated" / "index.html").read_text()
    assert f"{CalibrationFile.read(calibrated['calibration']).hash[:12]}…" in page
    assert f"{calibrated['residual']:.2%} of the signal, {raw['residual']:.2%} without" in page
    assert f"{raw['residual']:.2%} of the signal<" in (tmp_path / "raw" / "index.html").read_text()
    said = ps4rig("solve", path, "--out", tmp_path / "said").stdout
    assert f"median residual {calibrated['residual']:.2%}, {raw['residual']:.2%} without" in said


def test_python_says_how_to_solve_a_set_without_its_calibration(lab: Path, tmp_path: Path) -> None:
    path = tmp_path / "alone.ome.tif"
    shutil.copy(lab / "sets" / "rock-001.ome.tif", path)
    alone = CapturedSet.load(path)
    with pytest.raises(CalibrationError, match=r"alone.ome.tif: .*calibration=.*raw=True"):
        alone.solve()
    assert alone.solve(raw=True).valid.any()
    with pytest.raises(InputError, match="exclude each other"):
        alone.solve(calibration=Calibration(), raw=True)


def test_a_set_solves_with_the_calibration_it_was_captured_with(
    lab: Path, near_calibration: CalibrationFile
) -> None:
    with open_rig(lab / "rig.toml") as rig:
        captured = capture_set(rig, calibration=near_calibration)
    known = near_calibration.calibration
    np.testing.assert_array_equal(captured.solve().p, captured.solve(calibration=known).p)
    raw = captured.solve(raw=True)
    assert not np.array_equal(captured.solve().p, raw.p)
    about = captured.metadata.model_copy(update={"calibration_ids": ()})
    np.testing.assert_array_equal(replace(captured, metadata=about).solve().p, raw.p)


def test_a_set_without_its_calibration_is_refused_by_every_command(
    lab: Path, tmp_path: Path, ps4rig: Callable[..., Any], refused: Callable[..., str]
) -> None:
    path = tmp_path / "alone.ome.tif"
    shutil.copy(lab / "sets" / "rock-001.ome.tif", path)
    library = tmp_path / "textures.ps4lib"
    for command in (
        ("solve", path, "--out", tmp_path / "maps"),
        ("train", path, "--library", library),
        ("export", path, tmp_path / "a.ply"),
        ("export", path, tmp_path / "exported", "--maps"),
        ("compare", path, path, "--json"),
        ("classify", path, "--library", library),
        ("evaluate", path, "--library", library),
        ("evaluate", path, "--library", library, "--classifier", "polar"),
    ):
        line = refused(*command)
        assert "with the calibration" in line
        assert "give --calibration CAL" in line
        assert ps4rig(*command, "--calibration", lab / "rig.ps4cal").exit_code == 0
    choice = ("--raw", "--calibration", lab / "rig.ps4cal")
    for command in (
        ("solve", path, "--out", tmp_path / "x"),
        ("export", path, tmp_path / "x.ply"),
        ("compare", path, path, "--json"),
    ):
        assert "leave out --calibration" in refused(*command, *choice)


def test_export_and_compare_solve_as_solve_does(
    lab: Path, tmp_path: Path, ps4rig: Callable[..., Any], refused: Callable[..., str]
) -> None:
    path = tmp_path / "alone.ome.tif"
    shutil.copy(lab / "sets" / "rock-001.ome.tif", path)
    slopes, meshes = {}, set()
    for name, choice in (("given", ("--calibration", lab / "rig.ps4cal")), ("raw", ("--raw",))):
        solved(ps4rig, tmp_path / name, path, *choice)
        slopes[name] = tifffile.imread(tmp_path / name / "p.tif")
        exported = tmp_path / f"{name}-exported"
        assert ps4rig("export", path, exported, "--maps", *choice).exit_code == 0
        np.testing.assert_array_equal(tifffile.imread(exported / "p.tif"), slopes[name])
        assert ps4rig("export", path, tmp_path / f"{name}.ply", *choice).exit_code == 0
        meshes.add((tmp_path / f"{name}.ply").read_bytes())
        done = ps4rig("compare", path, tmp_path / name, "--json", *choice)
        assert json.loads(done.stdout)["maps"]["p"]["largest"] == 0.0
    assert len(meshes) == 2
    assert np.nanmax(np.abs(slopes["given"] - slopes["raw"])) > 0.01
    for choice in (("--calibration", lab / "rig.ps4cal"), ("--raw",)):
        for command in (
            ("export", path, tmp_path / "x.npz"), ("export", path, tmp_path / "x"),
            ("compare", tmp_path / "given", tmp_path / "raw", "--json"),
        ):  # fmt: skip
            assert "--calibration and --raw" in refused(*command, *choice)
    wrong = refused("export", path, lab / "rig.ps4cal", "--calibration", lab / "rig.ps4cal")
    assert "end the name in" in wrong


@pytest.mark.parametrize("name", ["images", "arrays.npz"])
def test_an_export_that_no_calibration_corrects_says_so(
    lab: Path, tmp_path: Path, ps4rig: Callable[..., Any], name: str
) -> None:
    done = ps4rig("export", lab / "sets" / "rock-001.ome.tif", tmp_path / name)
    assert done.exit_code == 0, done.stderr
    assert f"{name}: lights and pixel values are not corrected by" in done.stderr


def test_photographs_are_imported_with_a_calibration(
    lab: Path, tmp_path: Path, ps4rig: Callable[..., Any], refused: Callable[..., str]
) -> None:
    captured = CapturedSet.load(lab / "sets" / "rock-001.ome.tif")
    files = [tmp_path / f"{k}.png" for k in range(5)]
    for file, image in zip(files, [*captured.images, captured.ambient], strict=True):
        cv2.imwrite(str(file), np.asarray(image, np.uint16))
    arguments = (*files[:4], tmp_path / "p.ome.tif", "--slant", 45, "--ambient", files[4])
    options = ("--calibration", lab / "rig.ps4cal", "--bits", 12)
    # The calibration is of a simulated rig, photographs are real.
    assert "one is simulated" in refused("import", *arguments, *options)
    real = CalibrationFile.read(lab / "rig.ps4cal")
    for name, record in real.records.items():
        setting = record.setting.model_copy(update={"simulated": False})
        record = record.model_copy(update={"setting": setting})
        real = real.with_part(name, getattr(real.calibration, name), record)
    real.write(tmp_path / "real.ps4cal")
    plain = ps4rig("import", *arguments, "--bits", 12)
    assert plain.exit_code == 0, plain.stderr
    done = ps4rig(
        "import", *arguments, "--bits", 12, "--calibration", tmp_path / "real.ps4cal", "--force"
    )
    assert done.exit_code == 0, done.stderr
    imported = CapturedSet.load(tmp_path / "p.ome.tif")
    assert imported.metadata.calibration_ids == (real.hash,)
    assert imported.metadata.checks.light_levels == pytest.approx([1.0] * 4, abs=0.02)
    maps = solved(ps4rig, tmp_path / "maps", tmp_path / "p.ome.tif")
    assert maps["residual"] < 0.5 * maps["raw_residual"]
