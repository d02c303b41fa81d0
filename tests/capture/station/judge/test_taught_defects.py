"""What teaching says of defects: how strong they must be to be found, and of marks on all parts."""

from pathlib import Path
from typing import Any

import pytest

from capture.station.domain.recipe_file import RecipeFolder, read_recipe, write_recipe
from capture.station.domain.taught import DetectionLimit
from capture.station.judge.teaching.teaching import teach
from capture.station.judge.teaching.teaching_result import Teaching
from classify.defects.detectability import DEFECTS
from rig.config.simulation import Defect
from tests.capture.station.teaching_sets import patch
from tests.html_page import Page

NAME = "textured"
# Right and up from the middle of the frame.
MARK_PX = (40.0, 30.0)


SCRATCH = {"kind": "scratch", "size_px": 3.0, "strength": 2.314, "strongest": 3.0}
DENT = {"kind": "dent", "size_px": 40.0, "strength": 5.0, "strongest": 20.0, "mm_per_px": 0.05}
NO_DENT = {"kind": "dent", "size_px": 2.0, "strength": None, "strongest": 1.0, "mm_per_px": 0.5}
STAIN = {"kind": "stain", "size_px": 8.0, "strength": 0.314, "strongest": 0.8}


@pytest.mark.parametrize(
    ("values", "words", "fields"),
    [
        (SCRATCH, ["3 px wide", "2.3 px deep"], {"depth_px": 2.314}),
        (
            DENT,
            ["40 px (2 mm) wide", "5 px (0.25 mm) deep"],
            {"depth_px": 5.0, "size_mm": 2.0, "depth_mm": 0.25},
        ),
        (STAIN, ["8 px wide", "31% darker"], {"contrast": 0.314}),
        (NO_DENT, ["not found"], {"depth_px": None, "size_mm": 1.0, "depth_mm": None}),
    ],
)
def test_it_is_said_how_strong_a_defect_must_be(
    values: dict[str, Any], words: list[str], fields: dict[str, Any]
) -> None:
    found = DetectionLimit(**values)
    assert all(each in str(found) for each in words)
    common = {"kind": values["kind"], "size_px": values["size_px"], "text": str(found)}
    assert found.fields() == pytest.approx(common | fields)


def test_teaching_says_what_is_found_on_a_texture_that_passes(
    taught: tuple[Path, Teaching],
) -> None:
    teaching = taught[1]
    assert list(teaching.taught.least_found) == ["rock"]
    found = teaching.taught.least_found["rock"]
    assert [(each.kind, each.size_px) for each in found] == [each[:2] for each in DEFECTS]
    for each in found:
        assert each.strength is None or 0.0 < each.strength <= each.strongest
    assert any(each.strength is not None for each in found)
    sentences = list(teaching.least_found())
    assert sentences == [f"rock: {each}" for each in found]
    page = Page(teaching.files.report.read_text(encoding="utf-8")).text
    assert all(each in page for each in sentences)
    fields = teaching.fields()["least_found"]
    assert [(each["texture"], each["text"]) for each in fields] == [
        ("rock", str(each)) for each in found
    ]


def test_parts_without_a_mark_have_no_remark_on_one(taught: tuple[Path, Teaching]) -> None:
    assert not any("look alike in" in each for each in taught[1].remarks)


@pytest.mark.slow
def test_a_mark_on_all_taught_parts_is_named_and_a_limit_counts(tmp_path: Path) -> None:
    files = RecipeFolder(tmp_path / NAME)
    paths = [tmp_path / f"{number}.ome.tif" for number in range(6)]
    for number, path in enumerate(paths):
        shift = (70.0 * number, 45.0 * number)
        x_px, y_px = (a + b for a, b in zip(shift, MARK_PX, strict=True))
        mark = [
            Defect(kind=kind, x_px=x_px, y_px=y_px, size_px=40.0, depth_px=6.0, contrast=0.4)
            for kind in ("bump", "stain")
        ]
        placed = {"rotate_deg": 0.0, "shift_px": shift}
        patch("malv", number, **placed, defects=tuple(each.model_dump() for each in mark)).save(
            path
        )
    teaching = teach(files, paths)
    (remark,) = (each for each in teaching.remarks if "look alike in" in each)
    assert remark.startswith("malv: all 6 good parts look alike in ")
    numbers = [int(word) for word in remark.replace(",", "").split() if word.isdigit()]
    _, width, height, x, y = numbers
    assert abs(x + width / 2 - (128 + MARK_PX[0])) < 16
    assert abs(y + height / 2 - (128 - MARK_PX[1])) < 16
    recipe = read_recipe(files.file)
    limits = recipe.limits_of["malv"].model_copy(update={"defect": 1.5})
    write_recipe(files.file, recipe.model_copy(update={"limits_of": {"malv": limits}}))
    stricter = [each.strength or 9.0 for each in teaching.taught.least_found["malv"]]
    again = teach(files, [])
    weaker = [each.strength or 9.0 for each in again.taught.least_found["malv"]]
    assert all(a < b or a == 9.0 for a, b in zip(stricter, weaker, strict=True))
