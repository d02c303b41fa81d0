"""The command line: answers, exit statuses, and one line for each mistake."""

import json
import os
import re
import resource
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import tifffile

from capture import CapturedSet
from classify import TextureLibrary
from firmware_sim import SimulatedBoard, SimulatedController, VirtualClock, serve_pty

Command = Callable[..., Any]
Refused = Callable[..., str]


@pytest.fixture
def photographs(tmp_path: Path) -> list[Path]:
    paths = [tmp_path / f"image{light}.png" for light in range(4)]
    for light, path in enumerate(paths):
        cv2.imwrite(str(path), np.full((20, 30), 100 + light, np.uint8))
    return paths


@pytest.fixture
def in_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Work in an empty folder."""
    folder = tmp_path / "here"
    folder.mkdir()
    monkeypatch.chdir(folder)
    return folder


# capture


def test_a_simulated_capture_says_that_it_is_simulated(ps4rig: Command, tmp_path: Path) -> None:
    out = tmp_path / "a.ome.tif"
    result = ps4rig("capture", "--rig", "sim", "--size", 64, "--label", "oak", out)
    assert result.exit_code == 0
    # Ambient light and four LEDs, one frame each: 4 periods and an exposure.
    assert result.stdout.startswith(f"{out}: 4 lights in 6 frames, 18")
    assert result.stdout.endswith(" ms (simulated)\n")
    assert result.stderr == ""
    assert CapturedSet.load(out).metadata.simulated


def test_options_of_the_simulated_rig_arrive_in_the_set(ps4rig: Command, tmp_path: Path) -> None:
    out = tmp_path / "a.ome.tif"
    result = ps4rig(
        "capture", "--rig", "sim", "--surface", "sand", "--rotate", 33, "--slant", 30, "--shift-px",
        5, -7, "--seed", 9, "--bits", 10, "--size", 96, "--average", 2, "--label", "sand 1",
        "--json", out,
    )  # fmt: skip
    assert json.loads(result.stdout) == [{"set": str(out), "simulated": True}]
    metadata = CapturedSet.load(out).metadata
    assert metadata.placement is not None
    assert metadata.placement.model_dump() == {
        "surface": "sand", "rotate_deg": 33.0, "shift_px": (5.0, -7.0), "seed": 9,
    }  # fmt: skip
    assert (metadata.label, metadata.orientation_deg, metadata.bit_depth) == ("sand 1", 33.0, 10)
    assert CapturedSet.load(out).lighting.slants_deg.tolist() == [30.0] * 4
    assert CapturedSet.load(out).images.shape == (4, 96, 96)
    assert all(len(image.frames) == 2 for image in metadata.images)


def test_repeated_turns_and_counts_write_numbered_files(ps4rig: Command, tmp_path: Path) -> None:
    result = ps4rig(
        "capture", "--rig", "sim", "--size", 64, "--rotate", 0, "--rotate", 90, "--count", 2,
        tmp_path / "a.ome.tif",
    )  # fmt: skip
    assert result.exit_code == 0
    names = [f"a-00{number}.ome.tif" for number in (1, 2, 3, 4)]
    assert sorted(path.name for path in tmp_path.iterdir()) == names
    sets = [CapturedSet.load(tmp_path / name) for name in names]
    assert [each.metadata.orientation_deg for each in sets] == [0.0, 0.0, 90.0, 90.0]
    # Four sets, four sets of noise; the first two of one surface.
    assert len({each.metadata.pixels_sha256 for each in sets}) == 4
    first, again, turned = (each.images.astype(float) for each in sets[:3])
    assert abs(first - again).mean() < 0.3 * abs(first - turned).mean()


def test_a_wrong_turn_among_several_stops_before_the_first(
    refused: Refused, tmp_path: Path
) -> None:
    for wrong in ("1e9", "nan"):
        line = refused(
            "capture", "--rig", "sim", "--rotate", 0, "--rotate", wrong, tmp_path / "a.ome.tif"
        )
        assert "placement.rotate_deg" in line
    assert list(tmp_path.iterdir()) == []


def test_the_rig_is_the_one_in_rig_toml_and_nothing_becomes_simulated(
    ps4rig: Command, refused: Refused, in_folder: Path
) -> None:
    line = refused("capture", "a.ome.tif")
    assert line == (
        "rig.toml: no such rig configuration; write one with ps4rig rig init, or use --rig sim"
    )
    Path("rig.toml").write_text('name = "bench"\n')
    assert "lights.port is missing" in refused("capture", "a.ome.tif")
    Path("rig.toml").write_text('[lights]\nport = "/dev/ttyNONE"\n')
    assert refused("capture", "a.ome.tif").startswith("rig.toml: camera: device is missing")
    Path("rig.toml").write_text('[lights]\nport = "/dev/ttyNONE"\n[camera]\ndevice = 0\n')
    assert refused("capture", "a.ome.tif", status=3).startswith("/dev/ttyNONE: no such port")
    assert "for a simulated rig" in refused("capture", "--surface", "rock", "a.ome.tif")
    assert [path.name for path in in_folder.iterdir()] == ["rig.toml"]
    Path("rig.toml").write_text(
        '[lights]\nport = "simulated"\n[camera]\nwidth_px = 64\nheight_px = 48\n'
    )
    assert ps4rig("capture", "a.ome.tif").exit_code == 0


def test_a_real_controller_with_a_simulated_camera_is_refused(
    refused: Refused, in_folder: Path
) -> None:
    clock = VirtualClock()
    with serve_pty(SimulatedController(SimulatedBoard(clock), clock)) as server:
        Path("rig.toml").write_text(
            f'[lights]\nport = "{server.address}"\n[camera]\nkind = "simulated"\n'
        )
        assert "cannot see the LEDs" in refused("capture", "a.ome.tif")
    assert [path.name for path in in_folder.iterdir()] == ["rig.toml"]


@pytest.mark.parametrize(
    ("config", "status", "message"),
    [
        ("frame_rate_hz = 10\nexposure_ms = 100", 1, "set rejected: LED 0 .* saturated"),
        ("exposure_ms = 0.001", 1, "set rejected: LED 0 .* dark"),
        ("[simulation]\nambient = 0.9", 1, "set rejected: ambient light fills"),
        ("bits = 9", 2, "camera.bits"),
        ("bits = ", 2, "not valid TOML"),
        ("[simulation.placement]\nsurface = 'none'", 2, "surface 'none' is neither a material"),
    ],
)
def test_a_rejected_set_is_status_1_and_a_wrong_rig_status_2(
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
        (["a.tif"], "a.tif: a captured set is an OME-TIFF; let its name end in .ome.tif"),
        (["--bits", "9", "a.ome.tif"], "camera.bits"),
        (["--size", "8", "a.ome.tif"], "camera.width_px"),
        (["--slant", "90", "a.ome.tif"], "lights.slant_deg"),
        (
            ["--size", "64", "--average", "1025", "a.ome.tif"],
            "average is 1025; it must be 1 to 1024",
        ),
        (["--seed", "-1", "a.ome.tif"], "placement.seed"),
        (["--shift-px", "nan", "0", "a.ome.tif"], "placement.shift_px"),
        (["--surface", "no/such", "a.ome.tif"], "neither a material folder nor one of rock, sand"),
        (
            ["--size", "64", "--label", "two\nlines", "a.ome.tif"],
            r"label 'two\nlines': use printable",
        ),
        (
            ["--size", "64", "none/a.ome.tif"],
            "none/a.ome.tif: cannot be written: there is no folder",
        ),
    ],
)
def test_each_wrong_option_of_capture_has_its_line(
    refused: Refused, in_folder: Path, arguments: list[str], message: str
) -> None:
    assert message in refused("capture", "--rig", "sim", *arguments)
    assert list(in_folder.iterdir()) == []


def test_names_that_look_like_markup_are_printed_as_they_are(
    ps4rig: Command, in_folder: Path
) -> None:
    for name in ("[oak].ome.tif", "[bold]x.ome.tif", ":smile:.ome.tif", "x[~].ome.tif"):
        result = ps4rig("capture", "--rig", "sim", "--size", 64, name)
        assert result.stdout.startswith(f"{name}: 4 lights in ")
        assert (in_folder / name).is_file()


def test_wrong_usage_is_status_2(ps4rig: Command, tmp_path: Path) -> None:
    for arguments in (
        ["capture"],
        ["no-such-command"],
        ["capture", "--rig", "sim", "--average", "0", "a.ome.tif"],
        ["capture", "--rig", "sim", "--rotate", "north", "a.ome.tif"],
        ["import", "a.png", "--gamma", "2.2", "a.ome.tif"],
        ["solve", tmp_path / "a.ome.tif"],
    ):
        result = ps4rig(*arguments)
        assert result.exit_code == 2
        assert "Traceback" not in result.stderr


def test_every_command_has_help(ps4rig: Command) -> None:
    for name in ("demo", "capture", "import", "solve", "train", "classify", "evaluate"):
        result = ps4rig(name, "--help")
        assert result.exit_code == 0
        assert "Usage" in result.stdout
        assert name in ps4rig("--help").stdout


# import


def test_photographs_become_a_set(ps4rig: Command, photographs: list[Path], tmp_path: Path) -> None:
    out = tmp_path / "a.ome.tif"
    result = ps4rig("import", *photographs, "--slant", 40, "--label", "oak", "--json", out)
    assert json.loads(result.stdout) == {"set": str(out), "lights": 4}
    captured = CapturedSet.load(out)
    assert captured.lighting.tilts_deg.tolist() == [0.0, 90.0, 180.0, 270.0]
    assert captured.lighting.slants_deg.tolist() == [40.0] * 4
    assert [int(image[0, 0]) for image in captured.images] == [100, 101, 102, 103]
    assert not captured.metadata.simulated


def test_tilts_are_those_of_the_photographs_in_their_order(
    ps4rig: Command, photographs: list[Path], tmp_path: Path
) -> None:
    out = tmp_path / "a.ome.tif"
    result = ps4rig("import", *photographs[:3], "--tilts", "10,130,-110", "--slant", 40, out)
    assert result.stdout == f"{out}: 3 lights\n"
    assert CapturedSet.load(out).lighting.tilts_deg.tolist() == [10.0, 130.0, 250.0]


def test_a_light_list_that_names_its_images_is_enough(
    ps4rig: Command, photographs: list[Path], tmp_path: Path
) -> None:
    rows = [f"{path.name} {0.1 * light} 0.2 1" for light, path in enumerate(photographs)]
    (tmp_path / "lights.lp").write_text("\r\n".join(["4", *rows]))
    out = tmp_path / "a.ome.tif"
    assert ps4rig("import", "--lights", tmp_path / "lights.lp", out).exit_code == 0
    assert [image.source_file for image in CapturedSet.load(out).metadata.images] == [
        path.name for path in photographs
    ]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ([], "give --slant DEG of the lights, or --lights FILE"),
        (["--slant", "95"], "slant 95.0 is outside 0 to 89.9"),
        (["--slant", "nan"], "slant nan is outside"),
        (["--slant", "45", "--tilts", "0,90,180"], "4 images for 3 lights"),
        (["--slant", "45", "--tilts", "0,90,180,west"], "--tilts 0,90,180,west: give degrees"),
        (["--slant", "45", "--tilts", "0,90,180,inf"], "--tilts 0,90,180,inf: give degrees"),
        (["--slant", "45", "--lights", "x.lp"], "--lights gives the directions; leave out --slant"),
        (["--tilts", "0,90", "--lights", "x.lp"], "leave out --slant and --tilts"),
        (["--lights", "x.lp"], "x.lp: no such file"),
        (["--slant", "45", "--ambient", "none.png"], "none.png: no such file"),
        (["--slant", "45", "--label", "\x07"], "use printable characters"),
        (["--slant", "45", "--label", "Unknown"], "stands for a surface that matches no class"),
    ],
)
def test_each_wrong_option_of_import_has_its_line(
    refused: Refused, photographs: list[Path], tmp_path: Path, options: list[str], message: str
) -> None:
    assert message in refused("import", *photographs, *options, tmp_path / "a.ome.tif")
    assert not (tmp_path / "a.ome.tif").exists()


def test_each_wrong_photograph_has_its_line(
    refused: Refused, photographs: list[Path], tmp_path: Path
) -> None:
    out = tmp_path / "a.ome.tif"
    line = refused("import", *photographs, "--slant", 45)
    assert "image3.png: the last argument is the file to write" in line
    cv2.imwrite(str(tmp_path / "small.png"), np.zeros((5, 5), np.uint8))
    (tmp_path / "cut.png").write_bytes(photographs[0].read_bytes()[:60])
    tifffile.imwrite(tmp_path / "nan.tif", np.full((20, 30), np.nan, np.float32))
    cv2.imwrite(str(tmp_path / "a.jpg"), np.zeros((20, 30), np.uint8))
    for name, message in (
        ("small.png", "small.png: 5 x 5 px, but"),
        ("cut.png", "cut.png: not a complete PNG image"),
        ("nan.tif", "nan.tif: float32 pixels"),
        ("a.jpg", "a.jpg: a JPEG does not say"),
        ("none.png", "none.png: no such file"),
    ):
        line = refused("import", *photographs[:3], tmp_path / name, "--slant", 45, out)
        assert message in line
    assert not out.exists()


def test_three_photographs_cannot_be_solved_by_ps4(
    ps4rig: Command, refused: Refused, photographs: list[Path], tmp_path: Path
) -> None:
    out = tmp_path / "a.ome.tif"
    ps4rig("import", *photographs[:3], "--tilts", "0,120,240", "--slant", 40, out)
    line = refused("solve", out, "--out", tmp_path / "maps")
    assert "needs exactly 4 lights, this set has 3" in line
    assert not (tmp_path / "maps").exists()
    done = ps4rig("solve", out, "--method", "least_squares", "--out", tmp_path / "maps")
    assert done.exit_code == 0


# solve, train, classify, evaluate


def test_solve_writes_its_maps_and_says_how_much_is_valid(
    ps4rig: Command, sets: Path, tmp_path: Path
) -> None:
    source = sets / "rock-001.ome.tif"
    result = ps4rig("solve", source, "--out", tmp_path / "maps", "--json")
    answer = json.loads(result.stdout)
    assert set(answer) == {"set", "files", "valid", "saturated", "shadowed", "simulated"}
    assert answer["simulated"] is True
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


def test_classify_answers_with_exactly_the_agreed_fields(
    ps4rig: Command, sets: Path, library: Path
) -> None:
    paths = [sets / "rock-002.ome.tif", sets / "sand-002.ome.tif"]
    result = ps4rig("classify", *paths, "--library", library, "--json")
    assert result.stderr == ""
    rock, sand = json.loads(result.stdout)
    assert list(rock) == [
        "set", "label", "nearest", "orientation_deg", "distance", "runner_up",
        "runner_up_distance", "margin", "limit", "sharpness", "reason", "heading_deg", "simulated",
    ]  # fmt: skip
    assert 0.0 <= rock["distance"] <= rock["limit"]
    assert 0.0 <= rock["sharpness"] < sand["sharpness"] <= 1.0
    assert rock["reason"].startswith("rock is ")
    assert (rock["set"], rock["label"], rock["runner_up"]) == (str(paths[0]), "rock", "sand")
    assert (sand["label"], sand["nearest"], sand["simulated"]) == ("sand", "sand", True)
    assert sand["orientation_deg"] == pytest.approx(50.0, abs=5.0)
    assert 0.0 <= sand["distance"] < sand["runner_up_distance"]
    assert sand["margin"] == pytest.approx(1 - sand["distance"] / sand["runner_up_distance"])


def test_the_table_of_classify_says_what_was_simulated(
    ps4rig: Command, sets: Path, library: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "300")
    result = ps4rig("classify", sets / "sand-002.ome.tif", "--library", library)
    assert "sand-002.ome.tif (simulated)" in result.stdout
    assert result.exit_code == 0


def test_evaluate_answers_with_exactly_the_agreed_fields(
    ps4rig: Command, sets: Path, library: Path
) -> None:
    answer = json.loads(ps4rig("evaluate", sets, "--library", library, "--json").stdout)
    assert list(answer) == [
        "sets", "accuracy", "per_class", "confusion", "orientation_error_deg", "unknown",
        "headings", "reversed",
    ]  # fmt: skip
    assert (answer["sets"], answer["accuracy"], answer["unknown"]) == (4, 1.0, 0)
    assert answer["confusion"] == {"rock": {"rock": 2}, "sand": {"sand": 2}}
    assert answer["per_class"]["sand"]["sets"] == 2
    assert answer["per_class"]["sand"]["accuracy"] == 1.0
    assert set(answer["orientation_error_deg"]) == {"median", "p95"}
    assert 0.0 <= answer["orientation_error_deg"]["median"] <= 90.0
    table = ps4rig("evaluate", sets, "--library", library)
    assert "4 of 4 right (100.00%), 0 unknown" in table.stdout


def test_train_counts_its_references(ps4rig: Command, sets: Path, tmp_path: Path) -> None:
    paths = sorted(sets.glob("*.ome.tif"))
    library = tmp_path / "t.ps4lib"
    result = ps4rig("train", *paths, "--library", library, "--json")
    assert json.loads(result.stdout) == {
        "library": str(library), "classes": {"rock": 2, "sand": 2}, "simulated": True,
    }  # fmt: skip


def test_a_set_without_a_label_is_named(
    ps4rig: Command, refused: Refused, library: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "sets"
    folder.mkdir()
    out = folder / "a.ome.tif"
    ps4rig("capture", "--rig", "sim", "--size", 128, out)
    message = "a.ome.tif: has no label; capture or import it with --label"
    assert message in refused("train", out, "--library", tmp_path / "t.ps4lib")
    assert message in refused("evaluate", folder, "--library", library)
    assert not (tmp_path / "t.ps4lib").exists()


@pytest.mark.parametrize("command", ["solve", "train", "classify"])
def test_each_wrong_set_has_its_line(
    refused: Refused, sets: Path, library: Path, tmp_path: Path, command: str
) -> None:
    whole = (sets / "rock-001.ome.tif").read_bytes()
    for name, content, message in (
        ("cut.ome.tif", whole[: len(whole) // 2], "cut.ome.tif: "),
        ("edited.ome.tif", whole[:60_000] + b"?" + whole[60_001:], "do not match their SHA-256"),
        (
            "later.ome.tif",
            whole.replace(b'"schema_version": 1', b'"schema_version": 9'),
            "version 9",
        ),
        ("text.ome.tif", b"hello", "not a readable TIFF"),
        ("none.ome.tif", None, "none.ome.tif: no such file"),
    ):
        path = tmp_path / name
        if content is not None:
            path.write_bytes(content)
        target = {"solve": ["--out", tmp_path / "o"], "train": ["--library", tmp_path / "t.ps4lib"]}
        line = refused(command, path, *target.get(command, ["--library", library]))
        assert name in line
        assert message in line
    assert not (tmp_path / "o").exists()
    assert not (tmp_path / "t.ps4lib").exists()


def test_other_mistakes_have_their_line_too(
    refused: Refused, sets: Path, library: Path, tmp_path: Path
) -> None:
    rock = sets / "rock-001.ome.tif"
    assert "--method ps5: choose one of ps3a" in refused(
        "solve", rock, "--method", "ps5", "--out", tmp_path / "o"
    )
    (tmp_path / "file").touch()
    assert "file: cannot be made" in refused("solve", rock, "--out", tmp_path / "file")
    assert "no.ps4lib" in refused("classify", rock, "--library", tmp_path / "no.ps4lib")
    assert "file" in refused("classify", rock, "--library", tmp_path / "file")
    assert "no such file or folder" in refused("evaluate", tmp_path / "none", "--library", library)
    assert "holds no captured sets" in refused("evaluate", tmp_path, "--library", library)
    assert "none" in refused("train", rock, "--library", tmp_path / "none" / "t.ps4lib")


# as a process of its own: what other libraries say must not reach the user either


@pytest.mark.slow
def test_damaged_files_give_one_line_and_no_chatter_of_libraries(
    spawn: Command, sets: Path, photographs: list[Path], tmp_path: Path
) -> None:
    whole = (sets / "rock-001.ome.tif").read_bytes()
    cut = tmp_path / "cut.ome.tif"
    cut.write_bytes(whole[:1000])
    bad = tmp_path / "bad.png"
    content = bytearray(photographs[0].read_bytes())
    content[len(content) // 2] ^= 1
    bad.write_bytes(content)
    commands = (
        ["solve", cut, "--out", tmp_path / "o"],
        ["import", bad, *photographs[1:], "--slant", 45, tmp_path / "a.ome.tif"],
    )
    for process in [spawn(*arguments) for arguments in commands]:
        stdout, stderr = process.communicate(timeout=30)
        assert (process.returncode, stdout) == (2, "")
        assert len(stderr.splitlines()) == 1, stderr
        assert stderr.startswith("ps4rig: ")


@pytest.mark.slow
def test_a_full_disk_is_one_line_and_no_file(spawn: Command, tmp_path: Path) -> None:
    process = spawn(
        "capture", "--rig", "sim", "--size", 256, tmp_path / "a.ome.tif",
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000)),
    )  # fmt: skip
    stdout, stderr = process.communicate(timeout=30)
    assert (process.returncode, stdout) == (2, "")
    (line,) = stderr.splitlines()
    assert f"{tmp_path}/a.ome.tif: cannot be written" in line
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_usage_errors_are_one_line_too(spawn: Command, tmp_path: Path) -> None:
    for arguments, message in (
        (["capture", "--average", 0, tmp_path / "a.ome.tif"], "--average"),
        (["capture"], "OUT"),
        (["solve", tmp_path / "a.ome.tif"], "--out"),
        (["classify", "--colour", "x"], "--colour"),
        (["inspect"], "inspect"),
    ):
        process = spawn(*arguments)
        stdout, stderr = process.communicate(timeout=30)
        assert (process.returncode, stdout) == (2, "")
        (line,) = stderr.splitlines()
        assert line.startswith("ps4rig: ")
        assert message in line


def test_without_a_command_it_shows_what_there_is(spawn: Command) -> None:
    process = spawn()
    stdout, stderr = process.communicate(timeout=30)
    assert (process.returncode, stderr) == (0, "")
    assert all(name in stdout for name in ("demo", "capture", "import", "evaluate"))


def test_a_library_never_replaces_a_set(refused: Refused, sets: Path) -> None:
    rock = next(sets.glob("rock-001*"))
    before = rock.read_bytes()
    assert "end in .ps4lib" in refused("train", rock, "--library", rock)
    assert rock.read_bytes() == before


def test_a_library_of_simulated_sets_says_so(library: Path) -> None:
    assert TextureLibrary.load(library).simulated


def test_maps_say_what_set_they_come_from(ps4rig: Command, sets: Path, tmp_path: Path) -> None:
    rock = next(sets.glob("rock-001*"))
    assert ps4rig("solve", rock, "--out", tmp_path).exit_code == 0
    with tifffile.TiffFile(tmp_path / "p.tif") as tiff:
        origin = json.loads(tiff.pages.first.description)
    assert origin["simulated"] is True
    assert (origin["method"], origin["label"]) == (CapturedSet.load(rock).solve().method, "rock")
    assert origin["pixels_sha256"] == CapturedSet.load(rock).metadata.pixels_sha256


@pytest.mark.slow
def test_output_that_cannot_be_written_is_one_line(spawn: Command, sets: Path) -> None:
    rock = next(sets.glob("rock-001*"))
    with Path("/dev/full").open("w") as full:
        process = spawn("solve", rock, "--out", sets / "maps", stdout=full)
        _, stderr = process.communicate(timeout=30)
    assert (process.returncode, stderr) == (2, "ps4rig: No space left on device\n")


@pytest.mark.slow
def test_a_reader_that_has_gone_is_no_traceback(spawn: Command, sets: Path) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    rock = next(sets.glob("rock-001*"))
    process = spawn("solve", rock, "--out", sets / "maps", "--json", stdout=writing)
    os.close(writing)
    _, stderr = process.communicate(timeout=30)
    assert (process.returncode, stderr) == (2, "")


# real photographs: tests/data/butterfly_crop/README.md


def test_four_of_eight_real_photographs_give_the_gradients_of_all_eight(
    ps4rig: Command, tmp_path: Path
) -> None:
    data = Path(__file__).parent.parent / "data" / "butterfly_crop"
    options = ("--lights", data / "lights.json", "--ambient", data / "ambient.png")
    # The lights nearest to tilt 0, 90, 180 and 270.
    picked = [data / f"image{number}.png" for number in (6, 0, 2, 4)]
    for arguments in (
        ("import", *picked, *options, tmp_path / "four.ome.tif"),
        ("import", *options, tmp_path / "eight.ome.tif"),
        ("solve", tmp_path / "four.ome.tif", "--method", "ps4", "--out", tmp_path / "four"),
        ("solve", tmp_path / "eight.ome.tif", "--method", "least_squares", "--out",
         tmp_path / "eight"),
    ):  # fmt: skip
        assert ps4rig(*arguments).exit_code == 0
    valid = np.logical_and.reduce(
        [cv2.imread(str(tmp_path / name / "valid.png"), 0) > 0 for name in ("four", "eight")]
    )
    for name in ("p", "q"):
        four = tifffile.imread(tmp_path / "four" / f"{name}.tif")[valid]
        eight = tifffile.imread(tmp_path / "eight" / f"{name}.tif")[valid]
        assert np.corrcoef(four, eight)[0, 1] >= 0.97
    object_ = cv2.imread(str(data / "mask.png"), 0) > 0
    assert valid[object_].mean() > 0.95
    # The board is too dark for a slope: most of it is known not to be known.
    assert valid[~object_].mean() < 0.2
