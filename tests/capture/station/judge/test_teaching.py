"""Tests of teaching: the new version, its remarks, and refused sets."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import numpy as np
import pytest

from capture import CapturedSet
from capture.station.domain.errors import RecipeError
from capture.station.domain.recipe import Limits, Region, require_approved
from capture.station.domain.recipe_file import RecipeFolder, read_recipe, write_recipe
from capture.station.domain.taught import read_taught
from capture.station.domain.verdict import Cause, Decision
from capture.station.judge.approval import approve, approved_states, roll_back
from capture.station.judge.inspector import Inspector
from capture.station.judge.recipe_settings import save_settings, with_settings
from capture.station.judge.teaching.teaching import teach
from capture.station.judge.teaching.teaching_limits import limits_of_texture
from capture.station.judge.teaching.teaching_result import Teaching
from classify.pieces.piece_model import PieceModel
from rig.config.simulation import Defect
from tests.capture.station.results.parts import minimal
from tests.capture.station.teaching_sets import SIDE_PX, patch, saved
from tests.html_page import Page

T = TypeVar("T")


def test_good_parts_pass_and_bad_ones_fail(files: RecipeFolder) -> None:
    inspector = Inspector.load(files)
    assert inspector.inspect(CapturedSet.load(next(files.sets.glob("*")))).verdict
    bad = inspector.inspect(patch("sand", 77))
    assert (bad.verdict.decision, bad.verdict.causes[0]) == (Decision.FAIL, Cause.BAD_TEXTURE)
    other = inspector.inspect(patch("malv", 1))
    assert other.verdict.decision is Decision.UNKNOWN


def test_teaching_makes_a_new_version_that_nobody_approved(files: RecipeFolder) -> None:
    recipe = read_recipe(files.file)
    assert (recipe.version, recipe.passes, recipe.fails) == (2, ("rock",), ("loose sand",))
    with pytest.raises(RecipeError, match="is not approved"):
        require_approved(recipe)
    approved = approve(files, "Ada")
    require_approved(read_recipe(files.file))
    assert [each.name for each in files.version(2).folder.glob("approved-*")]
    again = teach(files, [])
    assert again.recipe.version == approved.version + 1
    assert again.files.report.is_file()
    assert again.recipe.approval is None


def test_a_texture_that_is_not_uniform_is_remarked_on(taught: tuple[Path, Teaching]) -> None:
    teaching = taught[1]
    assert teaching.fields()["uniformity"] == {"rock": "uniform", "loose sand": "uniform"}
    assert not any("rock is" in remark for remark in teaching.remarks)
    picture = replace(teaching, uniformity={"rock": "no texture", "loose sand": "varied"})
    assert any("rock is no texture" in remark for remark in picture.remarks)
    assert any("loose sand differs" in remark for remark in picture.remarks)


@pytest.mark.slow
def test_textures_that_cannot_be_told_apart_are_named(files: RecipeFolder, tmp_path: Path) -> None:
    more = saved(tmp_path / "more", "rock", range(10, 13))
    teaching = teach(files, more, "painted rock")
    pairs = {(each.texture, each.other) for each in teaching.overlaps}
    assert ("rock", "painted rock") in pairs
    assert ("painted rock", "rock") in pairs
    assert any("rock and painted rock overlap" in remark for remark in teaching.remarks)
    assert "overlap" in Page(teaching.files.report.read_text(encoding="utf-8")).text


def test_a_set_that_is_good_and_bad_is_refused(files: RecipeFolder, tmp_path: Path) -> None:
    known = sorted(files.sets.glob("*.ome.tif"))
    with pytest.raises(RecipeError, match="was taught as"):
        teach(files, known, "rust")
    with pytest.raises(RecipeError, match="'rock' is a good texture of recipe example"):
        teach(files, saved(tmp_path, "malv", range(1)), "rock")


def test_too_few_good_parts_are_refused(tmp_path: Path) -> None:
    files = RecipeFolder(tmp_path / "new")
    two = saved(tmp_path / "sets", "rock", range(2))
    with pytest.raises(RecipeError, match="2 good parts of 'rock'; give 3 or more"):
        teach(files, two)
    assert not files.file.exists()
    with pytest.raises(RecipeError, match="has no good parts yet"):
        teach(files, two, "rust")


def test_too_many_good_parts_are_refused_before_any_is_solved(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files = RecipeFolder(tmp_path / "line")
    monkeypatch.setattr("capture.station.judge.teaching.teaching.MAX_PARTS", 3)
    steps: list[str] = []

    def show(items: Iterable[T], total: int, description: str) -> Iterator[T]:  # noqa: ARG001
        steps.append(description)
        yield from items

    with pytest.raises(RecipeError, match="4 good parts of 'rock'"):
        teach(files, saved(tmp_path, "rock", range(4)), show=show)
    assert steps == []


@pytest.mark.slow
def test_sets_are_taught_anew_when_the_measurements_are_lost(files: RecipeFolder) -> None:
    files.version(2).taught.unlink()
    with pytest.raises(RecipeError, match="restore it from a backup, or remove"):
        teach(files, [])
    files.file.unlink()
    earlier = files.version(1).taught.read_bytes()
    again = teach(files, sorted(files.sets.glob("*.ome.tif"))[:3], good_texture="rock")
    assert again.recipe.version == 2
    assert files.version(1).taught.read_bytes() == earlier


def test_a_removed_file_is_no_longer_taught(files: RecipeFolder) -> None:
    bad = read_recipe(files.file)
    for each in read_taught(files.version(2).taught).textures["loose sand"].sets:
        (files.sets / each.file).unlink()
    teaching = teach(files, [])
    assert "loose sand" not in teaching.taught.textures
    assert teaching.recipe.version == bad.version + 1


def test_what_was_changed_since_teaching_is_refused(files: RecipeFolder) -> None:
    recipe = read_recipe(files.file)
    region = Region(x=0, y=0, width=64, height=64)
    write_recipe(files.file, recipe.model_copy(update={"region": region}))
    with pytest.raises(RecipeError, match=r"region is 64 x 64 px .* taught was the whole image"):
        Inspector.load(files)
    write_recipe(files.file, recipe)
    library = files.version(2).library
    library.write_bytes(files.version(1).library.read_bytes())
    with pytest.raises(RecipeError, match=r"textures.ps4lib: was changed since recipe example"):
        Inspector.load(files)
    files.version(2).taught.write_text("{}")
    with pytest.raises(RecipeError, match=r"taught.json: .*run ps4rig station teach"):
        Inspector.load(files)


def test_a_set_of_another_setting_is_an_error(files: RecipeFolder) -> None:
    captured = patch("rock", 3)
    about = captured.metadata
    camera = about.camera.model_copy(update={"exposure_ms": 10.0})
    for changes, reason in (
        ({"camera": camera}, "exposure 10 ms instead of 20 ms"),
        ({"rig_name": "other"}, "rig 'other' instead of 'rig'"),
        ({"simulated": False}, "one is simulated and the other is not"),
        ({"calibration_ids": ("0" * 64,)}, "the station has none"),
    ):
        metadata = about.model_copy(update=changes)
        changed = CapturedSet(captured.images, captured.ambient, metadata)
        verdict = Inspector.load(files).inspect(changed).verdict
        assert (verdict.decision, verdict.causes) == (Decision.ERROR, (Cause.CALIBRATION,))
        assert reason in verdict.reason


@pytest.mark.parametrize("kind", ["scratch", "stain"])
def test_a_defect_is_found_where_it_is(files: RecipeFolder, kind: str) -> None:
    # 40 px to the right of the centre and 30 px above it, in coordinates of the surface.
    defect = Defect(kind=kind, x_px=340.0, y_px=130.0, size_px=50.0, depth_px=8.0, contrast=0.6)
    placed = {"rotate_deg": 0.0, "shift_px": (300.0, 100.0)}
    part = patch("rock", 3, **placed, defects=(defect.model_dump(),))
    inspection = Inspector.load(files).inspect(part)
    assert inspection.verdict.decision is not Decision.PASS
    worst = inspection.defects[0]
    middle = worst.column + worst.width / 2, worst.row + worst.height / 2
    assert middle == pytest.approx((SIDE_PX / 2 + 40, SIDE_PX / 2 - 30), abs=16)
    assert worst.score > 1.0


def test_black_and_saturated_sets_are_errors(files: RecipeFolder) -> None:
    captured, inspector = patch("rock", 3), Inspector.load(files)
    for images in (np.zeros_like(captured.images), np.full_like(captured.images, 4095)):
        inspection = inspector.inspect(CapturedSet(images, None, captured.metadata))
        assert inspection.verdict.decision is Decision.ERROR
        assert inspection.verdict.causes[0] is Cause.CAPTURE
        assert inspection.recorded(minimal()).sdq is None


def test_a_dark_hole_that_no_map_can_judge_does_not_pass(files: RecipeFolder) -> None:
    captured = patch("rock", 3)
    images, hole = captured.images.copy(), np.s_[100:132, 60:92]
    images[:, *hole] = captured.ambient[hole]
    part = CapturedSet(images, captured.ambient, captured.metadata)
    inspection = Inspector.load(files).inspect(part)
    assert inspection.verdict.decision is not Decision.PASS
    assert inspection.measures.unjudged_px is not None
    assert inspection.measures.unjudged_px >= 256


def test_patches_of_one_texture_differ_in_slope_by_less_than_limits_assume(
    taught: tuple[Path, Teaching],
) -> None:
    sdqs = [part.sdq for part in taught[1].parts if part.kept_set.texture == "rock"]
    assert np.std(sdqs, ddof=1) < 0.01 * np.mean(sdqs)


def of_texture(sdqs: list[float]) -> Limits:
    return limits_of_texture(
        [0.4] * 3, sdqs, [0.0] * 3, [0.0] * 3, [0.3] * 3, 0.0, has_handedness=True
    )


def test_limits_of_equal_parts_leave_room() -> None:
    limits = of_texture([0.2] * 3)
    assert limits.sdq[0] < 0.199 < 0.201 < limits.sdq[1]
    assert limits.shadow_fraction == pytest.approx(0.005)
    assert limits.albedo == (pytest.approx(0.255), pytest.approx(0.345))
    assert limits.scale == (pytest.approx(0.99, abs=1e-3), pytest.approx(1.01, abs=1e-3))
    assert limits.handedness == 0.0


def test_parts_that_are_exactly_flat_have_limits() -> None:
    limits = of_texture([0.0] * 3)
    assert limits.sdq == (0.0, pytest.approx(0.001))


@pytest.mark.slow
def test_a_state_that_was_approved_comes_back_and_later_versions_stay(
    files: RecipeFolder,
) -> None:
    first = approve(files, "Ada")
    changed = with_settings(first, {"note": "another note"})
    save_settings(files, {"note": "another note"}, first.sha256)
    approve(files, "Bob", changed.sha256)
    assert {each.note for each in approved_states(files)} == {None, "another note"}
    with pytest.raises(RecipeError, match="changed by somebody else"):
        approve(files, "Eve", first.sha256)
    with pytest.raises(RecipeError, match="no approved state has hash"):
        roll_back(files, "0" * 64)
    assert roll_back(files, first.sha256) == read_recipe(files.file) == first
    # Of version 1, which was never approved, only the files are left.
    assert files.taught_versions() == [2, 1]
    write_recipe(files.file, first.model_copy(update={"version": 1}))
    again = teach(files, [])
    assert again.recipe.version == 3


@pytest.mark.slow
def test_approvals_within_a_second_keep_their_order(files: RecipeFolder) -> None:
    recipe = read_recipe(files.file)
    for note in (None, "other", None, "other"):
        write_recipe(files.file, recipe.model_copy(update={"note": note}))
        approved = approve(files, "Ada")
        assert approved_states(files)[0] == approved


@pytest.mark.slow
def test_a_limit_that_somebody_changed_stays_until_it_is_removed(files: RecipeFolder) -> None:
    found = read_recipe(files.file)
    measured = found.limits_of["rock"]
    by_hand = measured.model_copy(update={"sdq": (0.3, 0.4), "defect": 1.5})
    write_recipe(files.file, found.model_copy(update={"limits_of": {"rock": by_hand}}))
    for _ in range(2):
        teaching = teach(files, [])
        assert teaching.recipe.limits_of["rock"] == by_hand
        said = next(each for each in teaching.remarks if "limits_of.rock.sdq" in each)
        assert "0.3, 0.4 was set by somebody and stays; the taught parts give 0." in said
        assert any("limits_of.rock.defect = 1.5 was set by" in each for each in teaching.remarks)
        assert not any("distance" in each for each in teaching.remarks)
    # The parts that were taught are judged by the limit that stays.
    assert any("is FAIL: Sdq" in each for each in teaching.remarks)
    assert read_recipe(files.file) == teaching.recipe
    without = by_hand.model_copy(update={"sdq": None})
    write_recipe(files.file, found.model_copy(update={"limits_of": {"rock": without}}))
    assert teach(files, []).recipe.limits_of["rock"].sdq == measured.sdq


@pytest.mark.slow
def test_a_replaced_limit_is_named_where_nobody_knows_whether_it_was_taught(
    files: RecipeFolder,
) -> None:
    recipe = read_recipe(files.file)
    measured = recipe.limits_of["rock"]
    changed = measured.model_copy(update={"sdq": (0.3, 0.4), "defect": 1.5})
    write_recipe(files.file, recipe.model_copy(update={"limits_of": {"rock": changed}}))
    files.version(2).measured.unlink()  # as of a program that did not write it
    teaching = teach(files, [])
    assert teaching.recipe.limits_of["rock"] == measured.model_copy(update={"defect": 1.5})
    assert any("limits_of.rock.sdq = 0.3, 0.4 is replaced by" in each for each in teaching.remarks)


def test_good_textures_and_those_that_overlap_need_ten_parts(
    taught: tuple[Path, Teaching],
) -> None:
    teaching = taught[1]
    [remark] = [each for each in teaching.remarks if "teach 10 parts" in each]
    assert remark.startswith("rock: ")
    assert "is not approved" in remark
    is_rock = [part.kept_set.texture == "rock" for part in teaching.parts]
    matches = [
        replace(match, nearest="loose sand", runner_up="rock", label=None) if rock else match
        for match, rock in zip(teaching.matches, is_rock, strict=True)
        if match is not None
    ]
    remarks = "\n".join(replace(teaching, matches=tuple(matches)).remarks)
    assert f"rock: {sum(is_rock)} parts leave open" in remarks
    assert "loose sand: 2 parts leave open" in remarks
    assert remarks.count("; teach 10 parts or more") == 2


def test_teaching_says_which_texture_looks_like_its_mirror_image(
    taught: tuple[Path, Teaching],
) -> None:
    assert taught[1].recipe.limits_of["rock"].handedness is None
    assert any(each.startswith("rock looks like its mirror image") for each in taught[1].remarks)


def test_teaching_limits_what_windows_and_the_whole_part_may_be(
    taught: tuple[Path, Teaching],
) -> None:
    limits = taught[1].recipe.limits_for("rock")
    assert (limits.window, limits.seam, limits.octaves) == (1.0, 1.0, 1.0)
    for part, inspection in zip(taught[1].parts, taught[1].inspections, strict=True):
        if part.kept_set.texture == "rock":
            assert limits.albedo[0] < part.albedo < limits.albedo[1]
            assert limits.scale[0] < (inspection.measures.scale or 0.0) < limits.scale[1]


def test_a_piece_model_that_was_exchanged_is_refused(files: RecipeFolder) -> None:
    made = files.version(2)
    model = PieceModel.load(made.pieces(1))
    replace(model, scale_deviation=2.0).save(made.pieces(1))
    with pytest.raises(RecipeError, match=r"pieces-1\.ps4piece: was changed"):
        Inspector.load(files)
