"""The commands capture and solve."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import tifffile

from capture import CapturedSet
from classify import Lighting
from rig import Defect, Placement

Command = Callable[..., Any]
Refused = Callable[..., str]


# capture


def test_capture_prints_its_time_and_that_it_is_simulated(ps4rig: Command, tmp_path: Path) -> None:
    out = tmp_path / "a.ome.tif"
    result = ps4rig("capture", "--rig", "sim", "--size", 64, "--label", "oak", out)
    assert result.exit_code == 0
    # Six frames of ambient light and LEDs at 30 Hz: five periods and an exposure of 20 ms.
    assert result.stdout.startswith(f"{out}: 4 lights in 6 frames, 18")
    assert result.stdout.endswith(" ms (simulated)\n")
    assert result.stderr == ""
    assert CapturedSet.load(out).metadata.simulated


def test_the_set_contains_the_options_of_the_simulated_rig(ps4rig: Command, tmp_path: Path) -> None:
    out = tmp_path / "a.ome.tif"
    result = ps4rig(
        "capture", "--rig", "sim", "--surface", "sand", "--rotate", 33, "--slant", 30, "--shift-px",
        5, -7, "--seed", 9, "--bits", 10, "--size", 96, "--average", 2, "--label", "sand 1",
        "--defect", "stain,3,-4,20,0.6", "--defect", "foreign, 0, 30, 12, rock", "--json", out,
    )  # fmt: skip
    assert json.loads(result.stdout) == [{"set": str(out), "simulated": True}]
    metadata = CapturedSet.load(out).metadata
    assert metadata.placement is not None
    assert metadata.placement == Placement(
        surface="sand",
        rotate_deg=33.0,
        shift_px=(5.0, -7.0),
        seed=9,
        defects=(
            Defect(kind="stain", x_px=3.0, y_px=-4.0, size_px=20.0, contrast=0.6),
            Defect(kind="foreign", x_px=0.0, y_px=30.0, size_px=12.0, surface="rock"),
        ),
    )
    assert (metadata.label, metadata.orientation_deg, metadata.bit_depth) == ("sand 1", 33.0, 10)
    assert CapturedSet.load(out).lighting.slants_deg.tolist() == [30.0] * 4
    assert CapturedSet.load(out).images.shape == (4, 96, 96)
    assert all(len(image.frames) == 2 for image in metadata.images)


def test_a_defect_outside_the_frame_is_warned_of(ps4rig: Command, tmp_path: Path) -> None:
    result = ps4rig(
        "capture", "--rig", "sim", "--size", 64, "--shift-px", 0, 10, "--rotate", 0, "--rotate", 90,
        "--defect", "stain,0,38,20", "--defect", "dent,40,12,10", tmp_path / "a.ome.tif",
    )  # fmt: skip
    assert result.exit_code == 0
    assert result.stderr.splitlines() == [
        f"ps4rig: warning: dent at 40, 12: outside the frame of 64 x 64 px at {degrees} degrees"
        for degrees in (0, 90)
    ]


def test_a_calibration_target_is_captured_although_its_shading_is_that_of_no_surface(
    ps4rig: Command, refused: Refused, in_folder: Path
) -> None:
    in_folder.joinpath("rig.toml").write_text(
        '[lights]\nport = "simulated"\n[camera]\nwidth_px = 64\nheight_px = 64\n'
        "[[simulation.faults.leds]]\nkind = 'swapped'\nled = 0\nother = 1\n"
    )
    assert "not in the order" in refused("capture", "a.ome.tif", status=1)
    assert ps4rig("capture", "--target", "a.ome.tif").exit_code == 0
    mirror = ("--surface", "mirror_sphere", "--shift-px", 4, 0)
    assert ps4rig("capture", "--rig", "sim", *mirror, "b.ome.tif").exit_code == 0


def test_orientations_and_counts_write_numbered_files(ps4rig: Command, tmp_path: Path) -> None:
    result = ps4rig(
        "capture", "--rig", "sim", "--size", 64, "--rotate", 0, "--rotate", 90, "--count", 2,
        tmp_path / "a.ome.tif",
    )  # fmt: skip
    assert result.exit_code == 0
    names = [f"a-00{number}.ome.tif" for number in (1, 2, 3, 4)]
    assert sorted(path.name for path in tmp_path.iterdir()) == names
    sets = [CapturedSet.load(tmp_path / name) for name in names]
    assert [each.metadata.orientation_deg for each in sets] == [0.0, 0.0, 90.0, 90.0]
    # The noise of all sets differs; the surface of the first two sets is the same.
    assert len({each.metadata.pixels_sha256 for each in sets}) == 4
    first, second, rotated = (each.images.astype(float) for each in sets[:3])
    assert abs(first - second).mean() < 0.3 * abs(first - rotated).mean()


def test_an_orientation_is_entered_for_a_real_part(
    ps4rig: Command, in_folder: Path, made_set: Command
) -> None:
    made_set(np.full((4, 16, 16), 9000, np.uint16)).save("part.ome.tif")
    (in_folder / "rig.toml").write_text(
        '[lights]\nport = "simulated"\n[camera]\nkind = "replay"\nset_file = "part.ome.tif"\n'
    )
    result = ps4rig("capture", "--orientation", 20, "--target", "again.ome.tif")
    assert result.exit_code == 0
    assert CapturedSet.load("again.ome.tif").metadata.orientation_deg == 20.0


def test_an_orientation_must_be_that_of_a_simulated_part(
    ps4rig: Command, refused: Refused, tmp_path: Path
) -> None:
    path = tmp_path / "a.ome.tif"
    arguments = ("capture", "--rig", "sim", "--size", 32, path, "--orientation", 30)
    message = "--orientation 30: the simulated part is at 0 degrees; give --rotate 30 instead"
    assert refused(*arguments) == message
    assert "is at 20 degrees" in refused(*arguments, "--rotate", 30, "--rotate", 20)
    assert list(tmp_path.iterdir()) == []
    assert ps4rig(*arguments, "--rotate", 390).exit_code == 0
    assert CapturedSet.load(path).metadata.orientation_deg == 30.0


def test_numbers_go_on_after_existing_files_and_begin_at_1_with_force(
    ps4rig: Command, tmp_path: Path
) -> None:
    existing = tmp_path / "a-998.ome.tif"
    existing.touch()
    for other in ("ab-999.ome.tif", "a-9999.png", "a-x.ome.tif", "a.ome.tif"):
        (tmp_path / other).touch()
    before = {path.name for path in tmp_path.iterdir()}
    arguments = ("capture", "--rig", "sim", "--size", 64, "--count", 2, tmp_path / "a.ome.tif")
    assert ps4rig(*arguments).exit_code == 0
    after = {path.name for path in tmp_path.iterdir()}
    assert after - before == {"a-0999.ome.tif", "a-1000.ome.tif"}
    assert existing.stat().st_size == 0
    assert ps4rig(*arguments, "--force").exit_code == 0
    assert {path.name for path in tmp_path.iterdir()} - after == {"a-001.ome.tif", "a-002.ome.tif"}


def test_the_default_rig_is_rig_toml_and_not_the_simulated_rig(
    ps4rig: Command, refused: Refused, in_folder: Path
) -> None:
    line = refused("capture", "a.ome.tif")
    assert line.startswith("rig.toml: no such rig configuration; ")
    Path("rig.toml").write_text('name = "bench"\n')
    assert "lights.port is missing" in refused("capture", "a.ome.tif")
    Path("rig.toml").write_text('[lights]\nport = "/dev/ttyNONE"\n')
    assert refused("capture", "a.ome.tif").startswith("rig.toml: camera.device is missing")
    Path("rig.toml").write_text('[lights]\nport = "/dev/ttyNONE"\n[camera]\ndevice = 0\n')
    assert refused("capture", "a.ome.tif", status=3).startswith("/dev/ttyNONE: no such port")
    assert "not a simulated rig" in refused("capture", "--surface", "rock", "a.ome.tif")
    assert [path.name for path in in_folder.iterdir()] == ["rig.toml"]
    Path("rig.toml").write_text(
        '[lights]\nport = "simulated"\n[camera]\nwidth_px = 64\nheight_px = 48\n'
    )
    assert ps4rig("capture", "a.ome.tif").exit_code == 0


@pytest.mark.parametrize(
    ("config", "status", "message"),
    [
        ("frame_rate_hz = 10\nexposure_ms = 100", 1, "LED 0 .* saturated"),
        ("bits = ", 2, "not valid TOML"),
        ("[simulation.placement]\nsurface = 'none'", 2, "surface 'none' is neither"),
    ],
)
def test_a_rejected_set_is_status_1_and_a_wrong_configuration_status_2(
    refused: Refused, in_folder: Path, config: str, status: int, message: str
) -> None:
    camera = "[camera]\nwidth_px = 64\nheight_px = 64"
    Path("rig.toml").write_text(f'[lights]\nport = "simulated"\n{camera}\n{config}\n')
    line = refused("capture", "a.ome.tif", status=status)
    assert re.search(message, line)
    assert [path.name for path in in_folder.iterdir()] == ["rig.toml"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["a.tif"], "a.tif"),
        (["--rotate", "0", "--rotate", "nan", "a.ome.tif"], "placement.rotate_deg"),
        (["--defect", "dent,0,0", "a.ome.tif"], "--defect dent,0,0"),
        (["--defect", "foreign,0,0,9", "a.ome.tif"], "'foreign'"),
        (["--surface", "no/such", "a.ome.tif"], "of rock, sand"),
        (["none/a.ome.tif"], "none"),
    ],
)
def test_a_wrong_option_of_capture_is_one_line(
    refused: Refused, in_folder: Path, arguments: list[str], message: str
) -> None:
    assert message in refused("capture", "--rig", "sim", *arguments)
    assert list(in_folder.iterdir()) == []


def test_names_that_look_like_markup_are_printed_unchanged(
    ps4rig: Command, in_folder: Path
) -> None:
    for name in ("[oak].ome.tif", "[bold]x.ome.tif", ":smile:.ome.tif", "x[~].ome.tif"):
        result = ps4rig("capture", "--rig", "sim", "--size", 64, name)
        assert result.stdout.startswith(f"{name}: 4 lights in ")
        assert (in_folder / name).is_file()


# solve


def test_solve_writes_its_maps_and_prints_shares_of_pixels(
    ps4rig: Command, sets: Path, tmp_path: Path
) -> None:
    source = sets / "rock-001.ome.tif"
    result = ps4rig("solve", source, "--out", tmp_path / "maps", "--json")
    answer = json.loads(result.stdout)
    assert set(answer) == {
        "set", "files", "valid", "saturated", "shadowed", "planar", "fall_off", "led_levels",
        "simulated", "calibration", "residual", "raw_residual", "mm_per_px",
    }  # fmt: skip
    assert (answer["calibration"], answer["raw_residual"]) == (None, None)
    assert (answer["planar"], answer["simulated"]) == (False, True)
    assert 0.0 <= answer["fall_off"] < 0.25
    assert {Path(name).name for name in answer["files"]} >= {
        "p.tif", "q.tif", "albedo.tif", "normals.tif", "height.tif", "residual.tif", "shadow.png",
        "preview.png",
    }  # fmt: skip
    assert all(Path(name).stat().st_size > 0 for name in answer["files"])
    assert 0.9 < answer["valid"] <= 1.0
    plain = ps4rig("solve", source, "--out", tmp_path / "maps")
    assert plain.stdout.splitlines()[0] == (
        f"{tmp_path / 'maps'}: {len(answer['files'])} files (of a simulated set)"
    )


@pytest.mark.parametrize("given", [False, True])
def test_estimated_led_levels_are_printed_and_given_ones_are_used(
    ps4rig: Command, sets: Path, made_set: Callable[..., CapturedSet], tmp_path: Path, given: bool
) -> None:
    rock, levels = CapturedSet.load(sets / "rock-001.ome.tif"), np.array([1.0, 0.9, 1.0, 1.0])
    assert rock.ambient is not None
    images = np.rint((rock.images - 1.0 * rock.ambient) * levels[:, None, None]).clip(0)
    lighting = Lighting(rock.lighting.directions, np.ones(4) if given else np.empty(0))
    made_set(images.astype(np.uint16), lighting=lighting).save(tmp_path / "weak.ome.tif")
    command = ("solve", tmp_path / "weak.ome.tif", "--out", tmp_path / "maps")
    answer = json.loads(ps4rig(*command, "--json").stdout)
    printed = ps4rig(*command).stdout
    page = (tmp_path / "maps" / "index.html").read_text(encoding="utf-8")
    if given:
        assert answer["led_levels"] is None
        assert "LED levels" not in printed
        assert "1.000, 1.000, 1.000, 1.000, as given" in page
    else:
        found = np.array(answer["led_levels"])
        np.testing.assert_allclose(found / found[0], levels, atol=0.01)
        line = ", ".join(f"{level:.3f}" for level in found)
        assert f"LED levels {line} were found" in printed
        assert f"{line}, found in the images" in page


def test_levels_that_are_equal_as_printed_are_not_printed(
    ps4rig: Command, sets: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def nearly_equal(*_: object) -> np.ndarray:
        return np.array([1.0, 1.0001, 1.0, 0.9999], np.float32)

    monkeypatch.setattr("classify.solvers.robust.level_corrections", nearly_equal)
    result = ps4rig("solve", sets / "rock-001.ome.tif", "--out", tmp_path, "--workers", "1")
    assert "LED levels" not in result.stdout


def test_solve_prints_the_fall_off_that_it_divided_out(ps4rig: Command, tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    across = np.exp(np.linspace(-0.3, 0.3, 96))
    photographs = [tmp_path / f"{light}.png" for light in range(4)]
    for path, strength in zip(photographs, (across, 1.0, across[::-1], 1.0), strict=True):
        values = rng.uniform(90.0, 110.0, (96, 96)) * strength
        cv2.imwrite(str(path), np.rint(values).astype(np.uint8))
    out, maps = tmp_path / "a.ome.tif", tmp_path / "maps"
    assert ps4rig("import", *photographs, "--slant", 45, out).exit_code == 0
    distant = ps4rig("solve", out, "--out", maps).stdout.splitlines()
    assert re.fullmatch(r".* 4\d% .*--planar", distant[-1])
    planar = ps4rig("solve", out, "--out", maps, "--planar").stdout.splitlines()
    assert re.match(r"solved as a planar part: .* 4\d%", planar[-1])
    answer = json.loads(ps4rig("solve", out, "--out", maps, "--planar", "--json").stdout)
    assert (answer["planar"], answer["fall_off"]) == (True, pytest.approx(0.45, abs=0.03))
    assert json.loads((maps / "roughness.json").read_text())["planar"] is True
    assert abs(tifffile.imread(maps / "p.tif")).mean() < 0.1


@pytest.mark.parametrize(
    ("level", "cause"), [(0, "0% are saturated, 100% too dark"), (255, "100% are saturated")]
)
def test_a_set_without_a_valid_pixel_is_status_1_and_writes_nothing(
    ps4rig: Command, refused: Refused, tmp_path: Path, level: int, cause: str
) -> None:
    photographs = [tmp_path / f"{light}.png" for light in range(4)]
    for path in photographs:
        cv2.imwrite(str(path), np.full((20, 30), level, np.uint8))
    out = tmp_path / "a.ome.tif"
    accepted = ("--accept", "saturation", "--accept", "dark")
    assert ps4rig("import", *photographs, "--slant", 45, *accepted, out).exit_code == 0
    line = refused("solve", out, "--out", tmp_path / "maps", status=1)
    assert line.startswith(f"{out}: no pixel")
    assert cause in line
    assert not (tmp_path / "maps").exists()


# real photographs: tests/data/butterfly_crop/README.md
