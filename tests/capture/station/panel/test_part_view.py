"""The view of a stored part shows it as it was judged."""

import time
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from capture.sets.captured_set import CapturedSet
from capture.station.domain.folder import StationFolder
from capture.station.domain.recipe import Region
from capture.station.domain.recipe_file import write_recipe
from capture.station.domain.verdict import Decision, Verdict
from capture.station.judge.inspector import Inspector
from capture.station.panel import part_view as part_view_module
from capture.station.panel.judged_by import judged_by, recipe_of
from capture.station.panel.part_pictures import SIZES, painted
from capture.station.panel.part_view import part_view
from capture.station.panel.result_pages import measured_numbers
from capture.station.results.part_result import PartResult
from classify.base.errors import InputError
from classify.defects.defect_map import KINDS
from rig.config.simulation import Defect
from rig.set_file import pixels_sha256
from tests.capture.station.teaching_sets import patch

UTC = "2026-11-22T17:08:13.042Z"
STAIN = Defect(kind="stain", x_px=200.0, y_px=40.0, size_px=50.0, contrast=0.6)
PLACED = {"shift_px": (200.0, 40.0), "rotate_deg": 30.0, "defects": (STAIN.model_dump(),)}


@pytest.fixture(scope="module")
def stained() -> CapturedSet:
    return patch("rock", 9, **PLACED)


def inspected(inspector: Inspector, captured: CapturedSet) -> PartResult:
    """The result of a part, as the station records it."""
    part = PartResult(
        station="line-1", part_id="part-000001", number=1, trigger="http", triggered_utc=UTC,
        exposed_utc=UTC, decided_utc=UTC, verdict=Verdict(Decision.PASS, "not judged"),
        operator=None, simulated=True, software_version="1",
        recipe=inspector.recipe.name, recipe_version=inspector.recipe.version,
        recipe_sha256=inspector.recipe.sha256, set_sha256=captured.metadata.pixels_sha256,
    )  # fmt: skip
    return inspector.inspect(captured).recorded(part)


@pytest.mark.parametrize(
    ("region", "limit"),
    [(None, 1.0), (Region(x=40, y=24, width=200, height=216), 1.0), (None, 1.5)],
)
def test_defects_are_outlined_where_the_inspector_found_them(
    station: Path,
    stained: CapturedSet,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    region: Region | None,
    limit: float,
) -> None:
    folder, path = StationFolder(station), tmp_path / "part.ome.tif"
    stained.save(path)
    inspector = Inspector.load(folder.recipe_files())
    given = judged_by(folder, inspected(inspector, stained))
    limits = inspector.recipe.limits_for("rock").model_copy(update={"defect": limit})
    inspector.recipe = inspector.recipe.model_copy(
        update={"region": region, "limits_of": {"rock": limits}}
    )
    changed = replace(given, recipe=inspector.recipe)
    monkeypatch.setattr(part_view_module, "judged_by", lambda *_: changed)
    result = inspected(inspector, stained)
    assert result.defects

    view = part_view(folder, result, path)
    assert view.notes == ()
    assert np.nanmax(view.score) == pytest.approx(result.defect_score / limit)
    for defect, outline in zip(result.defects, view.outlines, strict=True):
        corners = np.array(outline)
        left, top = corners.min(axis=0)
        right, bottom = corners.max(axis=0)
        box = (left, top, right - left + 1, bottom - top + 1)
        assert box == (defect.column, defect.row, defect.width, defect.height)
        if defect.kind in KINDS:
            inside = view.score[top : bottom + 1, left : right + 1]
            assert np.nanmax(inside) == pytest.approx(defect.score)
    assert {each.kind for each in result.defects} > {"window"}
    if region is not None:
        outside = np.ones(view.albedo.shape, np.bool_)
        outside[region.y : region.y + region.height, region.x : region.x + region.width] = False
        assert not view.albedo[outside].any()
        assert np.isnan(view.score[outside]).all()
    assert {"defects", "defect-map", "slopes"} <= set(painted(view, "large"))


def test_defects_that_cannot_be_outlined_again_are_boxes_and_it_is_said(
    station: Path, stained: CapturedSet, tmp_path: Path
) -> None:
    folder, path = StationFolder(station), tmp_path / "part.ome.tif"
    stained.save(path)
    inspector = Inspector.load(folder.recipe_files())
    result = inspected(inspector, stained)
    first = replace(result.defects[0], column=result.defects[0].column + 8)
    other = replace(result, defects=(first, *result.defects[1:]))
    view = part_view(folder, other, path)
    assert view.outlines[0][0] == (first.column, first.row)
    assert "the defects are boxes" in view.notes[-1]


def test_the_recipe_of_then_is_found_after_a_change_while_its_approved_copy_is_kept(
    station: Path, stained: CapturedSet
) -> None:
    folder = StationFolder(station)
    files = folder.recipe_files()
    inspector = Inspector.load(files)
    result, recipe = inspected(inspector, stained), inspector.recipe
    numbers = {each.name: each for each in measured_numbers(result, recipe)}
    assert numbers["defect score"].is_beyond
    assert numbers["defect score"].limit == "at most 1.00"
    barely = replace(result, defect_score=1.0 + 1e-4)
    (number,) = (each for each in measured_numbers(barely, recipe) if each.name == "defect score")
    assert (number.value, number.limit, number.is_beyond) == ("1.0001", "at most 1.0000", True)
    write_recipe(files.file, recipe.model_copy(update={"note": "changed"}))
    with pytest.raises(InputError, match="is not kept as it was then"):
        recipe_of(folder, result)
    write_recipe(files.version(recipe.version).approved(recipe.sha256), recipe)
    assert recipe_of(folder, result) == recipe


@pytest.mark.parametrize(("size", "most_bytes"), [("small", 1 << 21), ("large", 1 << 24)])
def test_pictures_of_a_large_frame_are_reduced(
    station: Path, stained: CapturedSet, tmp_path: Path, size: str, most_bytes: int
) -> None:
    """``-s`` prints the processor time of a part."""
    assert stained.ambient is not None
    images, ambient = np.tile(stained.images, (1, 4, 5)), np.tile(stained.ambient, (4, 5))
    path, sha256 = tmp_path / "part.ome.tif", pixels_sha256(images, ambient, None)
    about = stained.metadata.model_copy(update={"pixels_sha256": sha256})
    CapturedSet(images, ambient, about).save(path)
    result = replace(inspected(Inspector.load(StationFolder(station).recipe_files()), stained),
                     set_sha256=sha256)  # fmt: skip
    took_ms = []
    for _ in range(3):
        began_s = time.process_time()
        made = painted(part_view(StationFolder(station), result, path), size)
        took_ms.append(1e3 * (time.process_time() - began_s))
    size_bytes = sum(len(picture.content) for picture in made.values())
    print(f"pictures of {images[0].size / 1e6:.1f} megapixels, {size}: {min(took_ms):.0f} ms of"
          f" one core, {size_bytes / 1e6:.1f} MB")  # fmt: skip
    for picture in made.values():
        decoded = cv2.imdecode(np.frombuffer(picture.content, np.uint8), cv2.IMREAD_COLOR)
        rows, columns = decoded.shape[:2]
        assert (columns, rows) == (SIZES[size], round(SIZES[size] * 4 / 5))
    assert size_bytes < most_bytes
