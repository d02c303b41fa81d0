"""Ways to a wrong PASS that no test of a single module covers; README.md lists all of them."""

from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import numpy.typing as npt
import pytest

from capture import CapturedSet, capture_set
from capture.base.errors import SetRejected
from capture.station.domain.errors import RecipeError
from capture.station.domain.folder import StationFolder, station_folder
from capture.station.domain.recipe_file import RecipeFolder, read_recipe, write_recipe
from capture.station.domain.verdict import Cause, Decision
from capture.station.judge.fault_study import FAULTS, Place, with_fault
from capture.station.judge.inspector import Inspector
from capture.station.judge.judge import verdict_of
from capture.station.run.events import PartAnnounced
from capture.station.run.live_view import LiveEvent
from capture.station.run.station_rig import StationRig
from classify import Match
from classify.base.errors import InputError
from classify.library.texture_library import TextureLibrary
from classify.lighting import RING_TILTS_DEG
from rig import CameraError, Placement, Rig, RigConfig, Switch, open_rig
from rig.fresh_frame import switch_to
from tests.capture.station.production import SMALL_RIG, run_parts
from tests.capture.station.teaching_sets import SIDE_PX, patch


def results_of(folder: Path, parts: int, meanwhile: Any = lambda _: None) -> list[Any]:
    found: list[Any] = []

    def listen(live: LiveEvent) -> None:
        if isinstance(live.event, PartAnnounced):
            found.append(live.event.result)
            meanwhile(len(found))

    run_parts(folder, parts, listen)
    return found


def test_a_camera_that_delivers_the_set_of_an_earlier_part_passes_nothing(
    line: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept: list[CapturedSet] = []

    def frozen(*args: Any, **options: Any) -> CapturedSet:
        kept.append(capture_set(*args, **options))
        return kept[0]

    monkeypatch.setattr("capture.station.run.station_rig.capture_set", frozen)
    first, *others = results_of(line, 3)
    assert first.verdict.decision is Decision.PASS
    for result in others:
        assert result.verdict.causes == (Cause.RIG,)
        assert f"every pixel is that of part number {first.number}" in result.verdict.reason


def test_hashes_of_pixels_are_bounded(line: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("capture.station.run.station_rig.MAX_KNOWN", 2)
    folder = StationFolder(line)
    inspector = Inspector.load(folder.recipe_files())
    rig = StationRig(folder.config, SMALL_RIG, inspector)
    sets = iter([1, 2, 3, 1, 3])
    captured = patch("rock", 3)

    def numbered(*_: Any, **__: Any) -> CapturedSet:
        about = captured.metadata.model_copy(update={"pixels_sha256": f"{next(sets):064}"})
        return replace(captured, metadata=about)

    monkeypatch.setattr("capture.station.run.station_rig.capture_set", numbered)
    rig.open()
    for number in range(1, 5):
        rig.capture(number)
    with pytest.raises(CameraError, match="of part number 3"):
        rig.capture(5)
    rig.close()


def test_recipe_library_and_defect_model_that_are_exchanged_during_a_run_judge_no_part(
    line: Path, files: RecipeFolder
) -> None:
    recipe, inspector = read_recipe(files.file), Inspector.load(files)
    made = files.version(recipe.version)

    def exchange(announced: int) -> None:
        if announced == 1:
            narrow = recipe.limits_of["rock"].model_copy(update={"sdq": (0.001, 0.002)})
            write_recipe(files.file, recipe.model_copy(update={"limits_of": {"rock": narrow}}))
            for path in (made.library, made.defects(1), made.taught):
                path.write_bytes(b"of another recipe")

    found = results_of(line, 3, exchange)
    assert {result.verdict.decision for result in found} == {Decision.PASS}
    hashes = {(result.recipe_sha256, result.library_sha256) for result in found}
    assert hashes == {(recipe.sha256, inspector.fingerprint.library_sha256)}
    with pytest.raises(InputError, match=r"taught\.json"):
        run_parts(line, 1, lambda _: None)


def test_two_runs_in_one_folder_are_refused(line: Path) -> None:
    with station_folder(line), pytest.raises(InputError, match="in use by ps4rig, process"):
        run_parts(line, 1, lambda _: None)


def test_a_library_that_is_exchanged_while_it_is_loaded_is_refused(
    files: RecipeFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = files.version(read_recipe(files.file).version).library
    load, other = TextureLibrary.load, files.version(1).library.read_bytes()

    def exchanged(_: Path) -> TextureLibrary:
        path.write_bytes(other)
        return load(path)

    monkeypatch.setattr(TextureLibrary, "load", exchanged)
    with pytest.raises(RecipeError, match=r"textures\.ps4lib: was changed"):
        Inspector.load(files)


@pytest.mark.parametrize(
    ("fault", "strength", "cause"),
    [
        ("hole", 0.2, Cause.WINDOW),
        ("worn strip", 0.1, Cause.WINDOW),
        ("stain of 30 %", 0.2, Cause.WINDOW),
        ("other scale", 1.1, Cause.SCALE),
        ("other scale", 0.9, Cause.SCALE),
        ("darker", 0.5, Cause.ALBEDO),
        ("deeper relief", 1.2, Cause.OCTAVES),
        ("deeper relief", 0.8, Cause.OCTAVES),
    ],
)
def test_a_fault_that_nobody_configured_does_not_pass(
    files: RecipeFolder, fault: str, strength: float, cause: Cause
) -> None:
    """Only the checks of windows and of the whole part: the others may find it too."""
    made = next(each for each in FAULTS if each.name == fault)
    changed = with_fault(patch("rock", 20), made, strength, Place(10.0, -20.0, 30.0))
    assert changed is not None
    inspection = Inspector.load(files).inspect(changed)
    assert inspection.verdict.decision is not Decision.PASS
    limits = read_recipe(files.file).limits_for("rock")
    of_texture = replace(inspection.measures, match=replace(
        cast(Match, inspection.measures.match), label="rock", distance=0.0, margin=None,
        runner_up=None, blur_px=0.0,
    ))  # fmt: skip
    wide = limits.model_copy(update={"defect": 1e6, "unjudged_px": 10**6})
    recipe = read_recipe(files.file).model_copy(update={"limits_of": {"rock": wide}})
    assert cause in verdict_of(recipe, of_texture).causes


@pytest.mark.parametrize(("gamma", "depth"), [(0.9, 1.0), (1.1, 1.0), (1.2, 1.2), (1.3, 1.2)])
def test_a_gamma_that_changed_and_is_not_reported_does_not_pass(
    files: RecipeFolder, gamma: float, depth: float
) -> None:
    """A gamma above 1 makes relief flatter, which hides a relief that is deeper."""
    part = patch("rock", 20)
    full_scale = part.metadata.full_scale

    def coded(values: npt.NDArray[np.uint16]) -> npt.NDArray[np.uint16]:
        return np.rint(full_scale * (values / full_scale) ** (1 / gamma)).astype(np.uint16)

    deeper = next(fault for fault in FAULTS if fault.name == "deeper relief")
    if depth != 1.0:
        part = cast(CapturedSet, with_fault(part, deeper, depth, Place(10.0, -20.0, 30.0)))
    inspector = Inspector.load(files)
    seen = replace(part, images=coded(part.images), ambient=coded(part.ambient))
    assert inspector.inspect(seen).verdict.decision is not Decision.PASS


@pytest.mark.parametrize(("rotated_deg", "passes"), [(0.0, True), (6.0, False), (-10.0, False)])
def test_a_camera_that_was_rotated_since_teaching_passes_nothing(
    files: RecipeFolder, rotated_deg: float, passes: bool
) -> None:
    part = patch("rock", 20)
    tilts_deg = tuple(tilt - rotated_deg for tilt in RING_TILTS_DEG)
    camera = {"width_px": SIDE_PX, "height_px": SIDE_PX}
    rotated = RigConfig().with_changes(lights={"tilts_deg": tilts_deg}, camera=camera)
    with open_rig(rotated) as rig:
        rig.simulation.place(part.metadata.placement)
        seen = capture_set(rig)
    seen = replace(
        seen, metadata=seen.metadata.model_copy(update={"lighting": part.metadata.lighting})
    )
    verdict = Inspector.load(files).inspect(seen).verdict
    assert (verdict.decision is Decision.PASS) == passes
    assert (Cause.CALIBRATION in verdict.causes) != passes


@pytest.mark.parametrize(("moved_px", "lights"), [(3.0, {3}), (3.0, {1, 2}), (40.0, {2})])
def test_a_part_that_moves_between_two_exposures_does_not_pass(
    files: RecipeFolder, monkeypatch: pytest.MonkeyPatch, moved_px: float, lights: set[int]
) -> None:
    """Moved by far, it is as good as another part of the same texture."""
    inspector = Inspector.load(files)
    there = Placement(surface="rock", rotate_deg=30.0, seed=1, shift_px=(100.0, 50.0))
    moved = there.model_copy(update={"shift_px": (100.0 + moved_px, 50.0)})
    with open_rig(SMALL_RIG) as rig:
        rig.simulation.place(there)
        assert inspector.inspect(capture_set(rig)).verdict.decision is Decision.PASS

        def switch_and_move(_: Rig, light: int | None) -> Switch:
            rig.simulation.place(moved if light in lights else there)
            return switch_to(rig, light)

        monkeypatch.setattr("capture.acquisition.light_images.switch_to", switch_and_move)
        try:
            captured = capture_set(rig)
        except SetRejected:
            return
    assert inspector.inspect(captured).verdict.decision is not Decision.PASS


@pytest.mark.parametrize(("most_deg", "is_beyond"), [(None, False), (0.01, True), (30.0, False)])
def test_a_recipe_limits_the_deviation_of_the_normal(
    files: RecipeFolder, most_deg: float | None, is_beyond: bool
) -> None:
    recipe = read_recipe(files.file)
    inspector = Inspector.load(files)
    limits = recipe.limits.model_copy(update={"angle_sd": most_deg})
    inspector.recipe = recipe.model_copy(update={"limits": limits})
    found = inspector.inspect(patch("rock", 20))
    assert (found.measures.angle_sd is None) == (most_deg is None)
    assert ("standard deviation of the normal" in found.verdict.reason) == is_beyond
