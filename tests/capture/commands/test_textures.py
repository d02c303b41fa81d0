"""The commands train, classify and evaluate."""

import csv
import json
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from capture import CapturedSet
from capture.maps.map_tiff import read_description
from classify import Lighting, TextureLibrary
from rig.set_file import pixels_sha256

Command = Callable[..., Any]
Refused = Callable[..., str]


def test_train_counts_the_sets_of_each_class(ps4rig: Command, sets: Path, tmp_path: Path) -> None:
    library = tmp_path / "t.ps4lib"
    result = ps4rig("train", sets, "--library", library, "--json")
    assert json.loads(result.stdout) == {
        "library": str(library), "classes": {"rock": 2, "sand": 2},
        "uniformity": {"rock": "uniform", "sand": "uniform"},
        "method": "ps4_robust", "planar": True, "simulated": True,
    }  # fmt: skip
    assert TextureLibrary.load(library).simulated
    assert TextureLibrary.load(library).planar


def test_train_names_a_class_that_is_no_texture(
    ps4rig: Command, sets: Path, tmp_path: Path
) -> None:
    captured, path = CapturedSet.load(sets / "rock-001.ome.tif"), tmp_path / "picture.ome.tif"
    images = captured.images.copy()
    images[:, : images.shape[1] // 2] = images.mean()
    sha256 = pixels_sha256(images, captured.ambient, captured.mask)
    metadata = captured.metadata.model_copy(update={"label": "picture", "pixels_sha256": sha256})
    replace(captured, images=images, metadata=metadata).save(path)
    library, other = tmp_path / "t.ps4lib", sets / "sand-001.ome.tif"
    result = ps4rig("train", path, other, "--library", library)
    assert "picture is no texture" in result.stdout
    assert "sand is" not in result.stdout
    (match,) = json.loads(ps4rig("classify", path, "--library", library, "--json").stdout)
    assert match["class_uniformity"] == "no texture"
    assert "picture is no texture" in match["reason"]


def test_train_replaces_a_library_with_force_only_and_never_a_set(
    ps4rig: Command, refused: Refused, sets: Path, tmp_path: Path
) -> None:
    rock, library = sets / "rock-001.ome.tif", tmp_path / "t.ps4lib"
    library.write_text("old")
    arguments = ("train", rock, sets / "sand-001.ome.tif", "--library")
    assert "t.ps4lib: exists already" in refused(*arguments, library)
    assert library.read_text() == "old"
    assert ps4rig(*arguments, library, "--force").exit_code == 0
    assert TextureLibrary.load(library).classes == ("rock", "sand")
    before = rock.read_bytes()
    assert "end in .ps4lib" in refused(*arguments, rock, "--force")
    assert rock.read_bytes() == before


def test_classify_prints_the_documented_fields(ps4rig: Command, sets: Path, library: Path) -> None:
    paths = [sets / "rock-002.ome.tif", sets / "sand-002.ome.tif"]
    result = ps4rig("classify", *paths, "--library", library, "--json")
    assert result.stderr == ""
    rock, sand = json.loads(result.stdout)
    assert list(rock) == [
        "set", "label", "nearest", "orientation_deg", "distance", "runner_up",
        "runner_up_distance", "margin", "limit", "sharpness", "reason", "heading_deg", "blur_px",
        "class_uniformity", "method", "library_method", "planar", "simulated",
    ]  # fmt: skip
    assert 0.0 <= rock["distance"] <= rock["limit"]
    assert 0.0 <= rock["sharpness"] < sand["sharpness"] <= 1.0
    assert f"{rock['distance']:.2f} to rock, limit" in rock["reason"]
    assert (rock["set"], rock["label"], rock["runner_up"]) == (str(paths[0]), "rock", "sand")
    assert (sand["label"], sand["nearest"], sand["simulated"]) == ("sand", "sand", True)
    assert sand["planar"] is True
    assert (sand["method"], sand["library_method"]) == ("ps4_robust", "ps4_robust")
    assert sand["orientation_deg"] == pytest.approx(50.0, abs=5.0)
    assert 0.0 <= sand["distance"] < sand["runner_up_distance"]
    assert sand["margin"] == pytest.approx(1 - sand["distance"] / sand["runner_up_distance"])


def test_sets_are_solved_as_those_of_their_library_were(
    ps4rig: Command, sets: Path, library: Path, tmp_path: Path
) -> None:
    path, old = sets / "sand-002.ome.tif", tmp_path / "old.ps4lib"
    replace(TextureLibrary.load(library), planar=False).save(old)
    answers = {}
    for each in (library, old):
        (answer,) = json.loads(ps4rig("classify", path, "--library", each, "--json").stdout)
        surface = CapturedSet.load(path).solve(planar=answer["planar"])
        assert answer["distance"] == TextureLibrary.load(each).classify(surface).distance
        answers[each] = answer
    assert (answers[library]["planar"], answers[old]["planar"]) == (True, False)
    assert answers[library]["distance"] != answers[old]["distance"]


def test_evaluate_prints_the_documented_fields(ps4rig: Command, sets: Path, library: Path) -> None:
    answer = json.loads(ps4rig("evaluate", sets, "--library", library, "--json").stdout)
    assert list(answer) == [
        "sets", "accuracy", "per_class", "confusion", "orientation_error_deg", "unknown",
        "headings", "reversed", "blur_px", "untaught", "training_sets", "methods",
        "library_method",
    ]  # fmt: skip
    assert answer["untaught"] == {"sets": 0, "unknown": 0, "accepted": 0, "confusion": {}}
    assert (answer["sets"], answer["accuracy"], answer["unknown"]) == (4, 1.0, 0)
    assert answer["confusion"] == {"rock": {"rock": 2}, "sand": {"sand": 2}}
    assert answer["per_class"]["sand"]["sets"] == 2
    assert answer["per_class"]["sand"]["accuracy"] == 1.0
    assert answer["per_class"]["sand"]["class_uniformity"] == "uniform"
    assert set(answer["orientation_error_deg"]) == {"median", "p95"}
    assert 0.0 <= answer["orientation_error_deg"]["median"] <= 90.0
    table = ps4rig("evaluate", sets, "--library", library)
    assert "4 of 4 right (100.00%), 0 unknown" in table.stdout


def relabelled(source: Path, path: Path, label: str) -> Path:
    captured = CapturedSet.load(source)
    metadata = captured.metadata.model_copy(update={"label": label})
    replace(captured, metadata=metadata).save(path)
    return path


def test_textures_that_were_not_taught_are_evaluated_for_themselves(
    ps4rig: Command, sets: Path, library: Path, tmp_path: Path
) -> None:
    others = [relabelled(sets / "rock-002.ome.tif", tmp_path / "oak.ome.tif", "oak")]
    others.append(tmp_path / "Fabric018.ome.tif")
    fabric = ("--surface", "Fabric018", "--label", "Fabric018", "--size", 128)
    ps4rig("capture", "--rig", "sim", *fabric, others[1])
    arguments = ("evaluate", sets / "sand-002.ome.tif", *others, "--library", library)
    answer = json.loads(ps4rig(*arguments, "--json").stdout)
    assert (answer["sets"], answer["accuracy"], answer["unknown"]) == (1, 1.0, 0)
    assert answer["confusion"] == {"sand": {"sand": 1}}
    assert answer["untaught"] == {
        "sets": 2, "unknown": 1, "accepted": 1,
        "confusion": {"oak": {"rock": 1}, "Fabric018": {"unknown": 1}},
    }  # fmt: skip
    table = ps4rig(*arguments).stdout
    assert "1 of 1 right" in table
    assert "1 of 2 sets rightly unknown" in table
    only = ps4rig("evaluate", others[1], "--library", library)
    assert "0 of" not in only.stdout
    assert "1 of 1 sets rightly unknown" in only.stdout
    answer = json.loads(ps4rig("evaluate", others[1], "--library", library, "--json").stdout)
    assert (answer["sets"], answer["accuracy"]) == (0, None)


def test_a_masked_set_is_compared_within_the_largest_square(
    ps4rig: Command, sets: Path, tmp_path: Path
) -> None:
    y, x = np.mgrid[:128, :128] - 63.5
    disc = np.hypot(x, y) < 60.0
    for name in ("rock-001", "sand-001", "sand-002"):
        whole = CapturedSet.load(sets / f"{name}.ome.tif")
        pixels = pixels_sha256(whole.images, whole.ambient, disc)
        fields = {"mask_file": "disc.png", "pixels_sha256": pixels}
        metadata = whole.metadata.model_copy(update=fields)
        replace(whole, metadata=metadata, mask=disc).save(tmp_path / f"{name}.ome.tif")
    library = tmp_path / "t.ps4lib"
    trained = [tmp_path / f"{label}-001.ome.tif" for label in ("rock", "sand")]
    ps4rig("train", *trained, "--library", library)
    # A square of 84 px holds two segments of 32 px, the frame of 128 px two of 64 px.
    assert TextureLibrary.load(library).segment_px == 32
    tested = (*trained, tmp_path / "sand-002.ome.tif")
    answers = json.loads(ps4rig("classify", *tested, "--library", library, "--json").stdout)
    assert [answer["label"] for answer in answers] == ["rock", "sand", "sand"]
    assert [answer["distance"] for answer in answers[:2]] == pytest.approx([0.0, 0.0], abs=1e-6)


def test_no_orientation_error_against_an_unknown_orientation(
    ps4rig: Command, sets: Path, tmp_path: Path
) -> None:
    """A training set without an orientation defines 0, whatever it really stood at."""
    training = CapturedSet.load(sets / "sand-002.ome.tif")
    metadata = training.metadata.model_copy(update={"orientation_deg": None})
    replace(training, metadata=metadata).save(tmp_path / "sand.ome.tif")
    library, table = tmp_path / "t.ps4lib", tmp_path / "t.csv"
    ps4rig("train", tmp_path / "sand.ome.tif", "--library", library)
    tested = ("evaluate", sets / "sand-001.ome.tif", "--library", library, "--json", "--csv", table)
    result = ps4rig(*tested)
    assert "no orientation error" in result.stderr
    answer = json.loads(result.stdout)
    assert (answer["accuracy"], answer["orientation_error_deg"]["median"]) == (1.0, None)
    with table.open(newline="") as file:
        (row,) = csv.DictReader(file)
    assert (row["true_orientation_deg"], row["orientation_error_deg"]) == ("0.0", "")


def test_a_training_set_among_the_tested_ones_is_warned_about(
    ps4rig: Command, sets: Path, library: Path, tmp_path: Path
) -> None:
    """By its pixels, so that a copy with another label counts too."""
    copy = relabelled(sets / "rock-001.ome.tif", tmp_path / "copy.ome.tif", "stone")
    tested = ("evaluate", copy, sets, "--library", library, "--json")
    for more in ((), ("--classifier", "polar")):
        result = ps4rig(*tested, *more)
        paths = [str(copy), str(sets / "rock-001.ome.tif"), str(sets / "sand-001.ome.tif")]
        assert json.loads(result.stdout)["training_sets"] == paths
        assert f"warning: {copy} and 2 more: " in result.stderr
    result = ps4rig("evaluate", sets / "rock-002.ome.tif", "--library", library, "--json")
    assert result.stderr == ""
    assert json.loads(result.stdout)["training_sets"] == []


@pytest.mark.parametrize("command", ["classify", "evaluate"])
def test_the_csv_has_a_row_for_each_set_and_a_value_in_each_cell(
    ps4rig: Command, refused: Refused, sets: Path, library: Path, tmp_path: Path, command: str
) -> None:
    table = tmp_path / "answers.csv"
    odd = relabelled(sets / "rock-001.ome.tif", tmp_path / 'a, "b".ome.tif', "=1+1")
    paths = [sets / "sand-002.ome.tif", odd]
    result = ps4rig(command, *paths, "--library", library, "--csv", table)
    assert result.exit_code == 0
    assert table.read_bytes().endswith(b"\r\n")
    with table.open(encoding="utf-8", newline="") as file:
        sand, rock = csv.DictReader(file, strict=True)
    assert list(sand) == [
        "set", "true_label", "true_orientation_deg", "label", "nearest", "orientation_deg",
        "distance", "runner_up", "runner_up_distance", "margin", "limit", "sharpness", "reason",
        "heading_deg", "blur_px", "class_uniformity", "method", "library_method", "planar",
        "simulated", "orientation_error_deg", "training_set",
    ]  # fmt: skip
    match = TextureLibrary.load(library).classify(CapturedSet.load(paths[0]).solve(planar=True))
    assert (sand["set"], sand["true_label"], sand["label"]) == (str(paths[0]), "sand", "sand")
    assert (float(sand["true_orientation_deg"]), sand["runner_up"]) == (50.0, "rock")
    for name in ("orientation_deg", "distance", "limit", "margin", "sharpness"):
        assert float(sand[name]) == getattr(match, name)
    assert match.orientation_deg is not None
    assert float(sand["orientation_error_deg"]) == pytest.approx(match.orientation_deg - 50.0)
    assert (sand["planar"], sand["simulated"], sand["training_set"]) == ("True", "True", "False")
    assert (rock["set"], rock["true_label"], rock["training_set"]) == (str(odd), "'=1+1", "True")
    # The zero of orientation differs between textures.
    assert (rock["label"], rock["orientation_error_deg"]) == ("rock", "")
    # An orientation is the same modulo 180; beside the true one it is the nearest.
    assert -90.0 <= float(rock["orientation_deg"]) < 90.0
    again = (command, *paths, "--library", library, "--csv")
    assert "exists already" in refused(*again, table)
    os.link(library, tmp_path / "library.csv")
    linked = (command, *paths, "--library", tmp_path / "library.csv", "--csv")
    assert "is an input" in refused(*linked, tmp_path / "library.csv", "--force")


@pytest.mark.parametrize(
    ("label", "message"),
    [
        (None, "has no label; "),
        ("Unknown", "label 'Unknown': "),
    ],
)
def test_a_set_without_a_usable_label_is_named(
    refused: Refused, sets: Path, library: Path, tmp_path: Path, label: str | None, message: str
) -> None:
    labelled = CapturedSet.load(sets / "rock-001.ome.tif")
    metadata = labelled.metadata.model_copy(update={"label": label})
    path = tmp_path / "a.ome.tif"
    CapturedSet(labelled.images, labelled.ambient, metadata).save(path)
    other = sets / "sand-001.ome.tif"
    assert f"{path}: {message}" in refused("train", path, other, "--library", tmp_path / "t.ps4lib")
    assert f"{path}: {message}" in refused("evaluate", path, "--library", library)
    assert not (tmp_path / "t.ps4lib").exists()


def test_sets_of_three_lights_are_solved_by_least_squares_everywhere(
    ps4rig: Command, made_set: Command, sets: Path, tmp_path: Path
) -> None:
    paths = []
    for name in ("rock", "sand"):
        paths.append(tmp_path / f"{name}.ome.tif")
        images = CapturedSet.load(sets / f"{name}-001.ome.tif").images[:3]
        three = Lighting.ring(45.0, [0, 90, 180])
        made_set(images, lighting=three, label=name).save(paths[-1])
    library, folders = tmp_path / "t.ps4lib", [tmp_path / "solved", tmp_path / "exported"]
    assert ps4rig("train", *paths, "--library", library).exit_code == 0
    assert TextureLibrary.load(library).method == "least_squares"
    result = ps4rig("classify", *paths, "--library", library, "--json")
    assert result.stderr == ""
    assert [row["label"] for row in json.loads(result.stdout)] == ["rock", "sand"]
    evaluated = json.loads(ps4rig("evaluate", *paths, "--library", library, "--json").stdout)
    assert evaluated["methods"] == ["least_squares"]
    assert ps4rig("solve", paths[0], "--out", folders[0]).exit_code == 0
    assert ps4rig("export", paths[0], folders[1], "--maps").exit_code == 0
    for folder in folders:
        assert read_description(folder / "p.tif")["method"] == "least_squares"
    compared = json.loads(ps4rig("compare", paths[0], folders[0], "--json").stdout)
    assert compared["maps"]["p"]["largest"] == 0.0
    assert CapturedSet.load(paths[0]).solve().method == "least_squares"


def test_another_solver_than_that_of_the_library_is_named(
    ps4rig: Command, sets: Path, library: Path
) -> None:
    arguments = (sets / "rock-001.ome.tif", "--library", library, "--method", "ps4", "--json")
    warning = "rock-001.ome.tif: solved by ps4, but "
    classified = ps4rig("classify", *arguments)
    assert warning in classified.stderr
    assert "was trained with ps4_robust" in classified.stderr
    (row,) = json.loads(classified.stdout)
    assert (row["method"], row["library_method"]) == ("ps4", "ps4_robust")
    evaluated = ps4rig("evaluate", *arguments)
    assert warning in evaluated.stderr
    answer = json.loads(evaluated.stdout)
    assert (answer["methods"], answer["library_method"]) == (["ps4"], "ps4_robust")


def test_a_solver_that_does_not_suit_the_lights_is_replaced_by_the_default(
    ps4rig: Command, made_set: Command, sets: Path, library: Path, tmp_path: Path
) -> None:
    images = CapturedSet.load(sets / "rock-001.ome.tif").images
    eight = tmp_path / "eight.ome.tif"
    tilts_deg = [0, 90, 180, 270] * 2
    made_set(np.concatenate([images, images]), lighting=Lighting.ring(45.0, tilts_deg)).save(eight)
    result = ps4rig("classify", eight, "--library", library, "--json")
    assert "eight.ome.tif: solved by least_squares" in result.stderr
    (row,) = json.loads(result.stdout)
    assert (row["label"], row["method"]) == ("rock", "least_squares")


def test_the_solver_of_the_library_is_kept(ps4rig: Command, sets: Path, tmp_path: Path) -> None:
    """In classify and evaluate, and where evaluate trains another classifier."""
    library = tmp_path / "t.ps4lib"
    ps4rig("train", sets, "--library", library, "--method", "least_squares")
    assert TextureLibrary.load(library).method == "least_squares"
    common = ("evaluate", sets, "--library", library, "--json")
    for more in ((), ("--classifier", "polar"), ("--classifier", "polar", "--method", "ps4")):
        result = ps4rig(*common, *more)
        answer = json.loads(result.stdout)
        solver = "ps4" if "--method" in more else "least_squares"
        assert (answer["methods"], answer["library_method"]) == ([solver], solver)
        assert "solved by" not in result.stderr


def test_training_sets_of_different_solvers_are_refused_by_name(
    refused: Refused, made_set: Command, sets: Path, tmp_path: Path
) -> None:
    four, eight = sets / "rock-001.ome.tif", tmp_path / "eight.ome.tif"
    images = CapturedSet.load(sets / "sand-001.ome.tif").images
    made_set(np.concatenate([images, images]), label="sand").save(eight)
    line = refused("train", four, eight, "--library", tmp_path / "t.ps4lib")
    assert f"({four} by ps4_robust, {eight} by least_squares)" in line
    assert "give --method least_squares" in line


def test_a_library_without_a_recorded_solver_says_so(
    ps4rig: Command, sets: Path, library: Path, tmp_path: Path
) -> None:
    earlier = tmp_path / "earlier.ps4lib"
    loaded = TextureLibrary.load(library)
    replace(loaded, method=None).save(earlier)
    result = ps4rig("classify", sets / "rock-001.ome.tif", "--library", earlier, "--json")
    assert "earlier.ps4lib: does not record" in result.stderr
    assert "solved by ps4_robust" in result.stderr
    (row,) = json.loads(result.stdout)
    assert (row["label"], row["library_method"]) == ("rock", None)


@pytest.mark.parametrize(
    "command", [("solve", "--out", "o"), ("train", "--library", "t.ps4lib"), ("evaluate",)]
)
def test_a_wrong_set_is_one_line(
    refused: Refused, sets: Path, library: Path, in_folder: Path, command: tuple[str, ...]
) -> None:
    whole = (sets / "rock-001.ome.tif").read_bytes()
    name, *output = command
    edited = whole[:60_000] + b"?" + whole[60_001:]
    for content in (whole[: len(whole) // 2], edited, b"hello", None):
        if content is None:
            Path("a.ome.tif").unlink()
        else:
            Path("a.ome.tif").write_bytes(content)
        line = refused(name, "a.ome.tif", *(output or ("--library", library)))
        assert "a.ome.tif: " in line
    assert list(in_folder.iterdir()) == []


def test_a_training_set_whose_name_is_not_utf_8_is_refused(
    refused: Refused, sets: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "sets"
    folder.mkdir()
    os.link(sets / "rock-001.ome.tif", folder / "\udcff.ome.tif")
    line = refused("train", folder, "--library", tmp_path / "t.ps4lib")
    assert "not valid UTF-8" in line
