"""`python -m tests.evidence.photographs`: folders, picks of lights, errors, files."""

import csv
import json
import shutil
from collections import Counter
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from capture.chapter.output import PageInfo
from classify import Lighting
from classify.base.errors import InputError
from rig.scene.render import render_frame
from rig.scene.synthetic import synthetic_surface
from tests.evidence.photographs import run
from tests.evidence.photographs.exhibits import photograph_exhibits
from tests.evidence.photographs.photograph_set import PhotographSet, load_photographs
from tests.evidence.photographs.recognition import PATCH_PX, recognitions
from tests.evidence.photographs.run import reproduce_photographs
from tests.evidence.photographs.scores import scores_of, solve_pick
from tests.html_page import self_contained

SIDE_PX = 64
EIGHT = Lighting.ring(40.0, tuple(np.arange(0.0, 360.0, 45.0)))


def photographed(name: str, side_px: int) -> PhotographSet:
    """A matt surface under eight lights; the true p is the reference."""
    scene = render_frame(synthetic_surface(name, 0, 2 * side_px), EIGHT, side_px, ambient=0.0)
    images = np.rint(4000.0 * scene.lights).astype(np.uint16)
    lit = ~scene.shadowed.any(axis=0)
    return PhotographSet(name, images, None, 4095.0, EIGHT.directions, None, lit, scene.p)


@pytest.fixture(scope="module")
def photographs() -> PhotographSet:
    return photographed("malv", SIDE_PX)


@pytest.fixture
def folder(photographs: PhotographSet, tmp_path: Path) -> Path:
    """The same surface as files, with a black border on all sides."""
    folder = tmp_path / "photographs" / "malv"
    folder.mkdir(parents=True)
    lights = []
    for light, direction in enumerate(photographs.directions):
        name = f"{light}.png"
        cv2.imwrite(str(folder / name), np.pad(photographs.images[light], 20))
        lights.append({"file": name, "direction": direction.tolist(), "tilt_deg": 45.0 * light})
    (folder / "lights.json").write_text(json.dumps({"images": lights, "mm_per_pixel": 0.5}))
    height_mm = np.cumsum(np.pad(0.5 * photographs.reference_p, 20), axis=1)
    np.save(folder / "reference_height_mm.npy", height_mm)
    return folder


def test_picks_are_rings_of_four_that_share_at_most_two_lights(photographs: PhotographSet) -> None:
    first, second = photographs.picks()
    assert {frozenset(first), frozenset(second)} == {
        frozenset({0, 2, 4, 6}),
        frozenset({1, 3, 5, 7}),
    }
    # Anticlockwise, 90 degrees apart.
    assert all((after - light) % 8 == 2 for light, after in pairwise(first))
    crowded = replace(photographs, directions=Lighting.ring(40.0, (0, 10, 20, 30)).directions)
    assert crowded.picks() == []


def test_four_photographs_of_a_matt_surface_predict_the_others(photographs: PhotographSet) -> None:
    scores = list(scores_of(photographs))
    assert {(each.method, each.planar) for each in scores} == {
        (method, planar)
        for method in ("ps4", "ps4_robust", "least_squares")
        for planar in (False, True)
    }
    for score in scores:
        assert score.reference_r is not None
        assert score.reference_r > 0.99
        assert score.valid_pct == 100.0
        if not score.planar:
            assert score.median_pct is not None
            assert score.mean_pct is not None
            assert score.median_pct < score.mean_pct < 1.5
    dim = photographs.images.copy()
    dim[[1, 3]] //= 2  # the gain of each predicted light is free
    of_dim = list(scores_of(replace(photographs, images=dim)))
    assert of_dim[0].median_pct == pytest.approx(scores[0].median_pct, abs=0.05)


def test_an_error_of_the_lights_shows_in_the_prediction(photographs: PhotographSet) -> None:
    exchanged = photographs.images[[2, 1, 0, 3, 4, 5, 6, 7]]
    for good, bad in zip(
        scores_of(photographs), scores_of(replace(photographs, images=exchanged)), strict=True
    ):
        if good.pick[0] % 2 == 0 and not good.planar:
            assert good.mean_pct is not None
            assert bad.mean_pct is not None
            assert bad.mean_pct > 5.0 * good.mean_pct


@settings(deadline=None, max_examples=10)
@given(st.integers(1, 3))
def test_rotated_and_mirrored_photographs_have_the_rotated_and_mirrored_slopes(
    photographs: PhotographSet, quarters: int
) -> None:
    pick = photographs.picks()[0]
    still = solve_pick(photographs, pick, "least_squares")
    rotated = photographs
    for _ in range(quarters):
        rotated = rotated.rotated()
    found = solve_pick(rotated, pick, "least_squares")
    slope = np.rot90(still.p + 1j * still.q, quarters) * 1j**quarters
    np.testing.assert_allclose(found.p + 1j * found.q, slope, atol=1e-4)
    mirrored = solve_pick(photographs.mirrored(), pick, "least_squares")
    np.testing.assert_allclose(mirrored.p, -still.p[:, ::-1], atol=1e-4)
    np.testing.assert_allclose(mirrored.q, still.q[:, ::-1], atol=1e-4)


@pytest.mark.slow
def test_objects_are_recognised_and_refused_where_they_are_not_taught(
    photographs: PhotographSet,
) -> None:
    textures = [photographed(name, PATCH_PX + 40) for name in ("ogil", "rock", "sand")]
    found = recognitions([*textures, photographs])  # the last is too small
    kinds = Counter((each.trial.label, each.kind) for each in found)
    assert kinds == {
        (texture.name, kind): count
        for texture in textures
        for kind, count in (
            ("rotated by quarter turns", 3), ("another corner", 3), ("other lights", 1),
        )
    }  # fmt: skip
    assert all(each.trial.is_correct for each in found)
    # One of the three objects is taught: each of the others twice.
    assert [len(each.unknown) for each in found] == [2] * len(found)
    assert {match.label for each in found for match in each.unknown} == {None}
    table = next(
        each
        for each in photograph_exhibits(textures, [], found)
        if each.key == "photographs_recognition"
    )
    assert table.rows[0] == (
        "rotated by quarter turns",
        9,
        100.0,
        0.0,
        0.0,
        18,
        0.0,
        0.0,
        None,
        None,
    )
    assert table.rows[-1] == ("all", 21, 100.0, 0.0, 0.0, 42, 0.0, 0.0, None, None)
    texts = PageInfo("photographs", Path(run.__file__), simulated=False).texts
    assert "patch of 256 x 256 px" in table.text_from(texts).notes[0]
    assert recognitions([textures[0], photographs]) == []


def test_a_folder_is_read_and_cut_to_the_object(folder: Path, photographs: PhotographSet) -> None:
    read = load_photographs(folder)
    assert read.images.shape == (8, SIDE_PX + 16, SIDE_PX + 16)
    assert not read.mask[:8].any()
    np.testing.assert_array_equal(read.images[:, 8:-8, 8:-8], photographs.images)
    assert read.intensities is None
    assert not read.lighting_of((0, 1, 2, 3)).intensities_given
    assert read.reference_p is not None
    found, p = read.reference_p[8:-8, 8:-8], photographs.reference_p
    # Central differences of a height that was summed along the rows.
    np.testing.assert_allclose(found[:, :-1], 0.5 * (p[:, :-1] + p[:, 1:]), atol=1e-4)


def test_without_other_lights_there_is_no_error_of_a_prediction(photographs: PhotographSet) -> None:
    four = replace(
        photographs, images=photographs.images[::2], directions=photographs.directions[::2]
    )
    scores = list(scores_of(four))
    assert scores
    assert all(each.median_pct is None and each.mean_pct is None for each in scores)


def test_intensities_of_the_folder_are_given_to_the_solver(folder: Path) -> None:
    notes = json.loads((folder / "lights.json").read_text())
    for light in notes["images"]:
        light["relative_intensity_estimated"] = 0.5
    (folder / "lights.json").write_text(json.dumps(notes))
    lighting = load_photographs(folder).lighting_of((0, 2, 4, 6))
    assert lighting.intensities_given
    np.testing.assert_array_equal(lighting.intensities, 0.5)


def test_the_page_has_tables_and_pictures(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    page = reproduce_photographs(folder.parent, out)
    html = self_contained(page)
    assert "real photographs" in html
    assert "Simulated" not in html
    assert json.loads((out / "results.json").read_text())["simulated"] is False
    with (out / "photographs_picks.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 12
    assert all(float(row["changed by turning, %"]) < 1.0 for row in rows)
    assert (out / "photographs_maps.png").read_bytes().startswith(b"\x89PNG")


def test_a_light_that_cannot_be_is_left_out_with_a_warning(
    folder: Path, photographs: PhotographSet
) -> None:
    notes = json.loads((folder / "lights.json").read_text())
    for file, direction in (("low.png", [0.75, 0.0, -0.0002]), ("none.png", [0.0, 0.0, 0.0])):
        notes["images"].insert(3, {"file": file, "direction": direction})
    notes["images"].append({"file": "dim.png", "direction": [0, 0, 1], "intensity": 1e-9})
    (folder / "lights.json").write_text(json.dumps(notes))
    read = load_photographs(folder)
    np.testing.assert_array_equal(read.directions, photographs.directions)
    np.testing.assert_array_equal(read.images[:, 8:-8, 8:-8], photographs.images)
    zero, low, dim = read.warnings
    assert f"{folder}/lights.json: image 3, none.png" in zero
    assert "image 4, low.png" in low
    assert "[0.75, 0.0, -0.0002]" in low
    assert "image 10, dim.png" in dim


@pytest.mark.parametrize("coding", ["utf-8-sig", "utf-16"])
def test_photographs_are_found_as_a_list_of_lights_finds_them(folder: Path, coding: str) -> None:
    notes = json.loads((folder / "lights.json").read_text())
    (folder / "raw").mkdir()
    for light in notes["images"]:
        (folder / light["file"]).rename(folder / "raw" / f"u\u0308{light['file']}")
        light["file"] = f".\\raw\\\u00fc{light['file']}"
    (folder / "lights.json").write_text(json.dumps(notes), encoding=coding)
    assert len(load_photographs(folder).images) == 8


@pytest.mark.slow
def test_a_bad_folder_is_left_out_with_a_warning_and_on_the_page(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bad = folder.with_name("bad")
    shutil.copytree(folder, bad)
    (bad / "3.png").write_bytes(b"no picture")
    page = reproduce_photographs(folder.parent, tmp_path / "out")
    warning = f"bad is left out: {bad}/3.png: not a complete PNG image"
    assert f"ps4rig: warning: {warning}" in capsys.readouterr().err
    assert warning in page.read_text(encoding="utf-8")
    results = json.loads((tmp_path / "out" / "results.json").read_text())
    picks = results["exhibits"]["photographs_picks"]["rows"]
    assert {row[0] for row in picks} == {"malv"}


def refusal(photographs: Path, out: Path) -> str:
    with pytest.raises(InputError) as raised:
        reproduce_photographs(photographs, out)
    return str(raised.value)


def test_a_folder_without_a_ring_or_an_object_is_refused(folder: Path, tmp_path: Path) -> None:
    def line() -> str:
        return refusal(folder.parent, tmp_path / "out")

    notes = json.loads((folder / "lights.json").read_text())
    crowded = Lighting.ring(40.0, tuple(range(0, 80, 10))).directions
    for light, direction in zip(notes["images"], crowded, strict=True):
        light["direction"] = direction.tolist()
    (folder / "lights.json").write_text(json.dumps(notes))
    assert "no four of its 8 lights" in line()
    for light in notes["images"]:
        cv2.imwrite(str(folder / light["file"]), np.zeros((104, 104), np.uint16))
    assert "no pixel is brighter" in line()
    assert not (tmp_path / "out").exists()


def test_bad_input_is_refused(folder: Path, tmp_path: Path) -> None:
    def line(photographs: Path) -> str:
        return refusal(photographs, tmp_path / "out")

    assert "no such folder" in line(tmp_path / "no")
    assert "lights.json" in line(folder)
    np.save(folder / "reference_height_mm.npy", np.zeros((3, 3)))
    assert "has shape (3, 3)" in line(folder.parent)
    cv2.imwrite(str(folder / "mask.png"), np.zeros((104, 104), np.uint8))
    assert "mask.png" in line(folder.parent)
    (folder / "lights.json").write_text('{"images": [{"file": "0.png"}]}')
    assert "images.0.direction" in line(folder.parent)
    assert not (tmp_path / "out").exists()
