"""Conditions before a running station takes a recipe, with a taught recipe."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import pytest

from capture.station.domain.errors import ChallengeFailed, NotApproved
from capture.station.domain.folder import LAST_RECIPE, StationFolder, first_recipe, keep_recipe
from capture.station.domain.recipe_file import RecipeFolder, read_recipe, write_recipe
from capture.station.judge.approval import approve, roll_back
from capture.station.judge.challenge_set import add_to_challenge, challenge_sets
from capture.station.judge.inspector import Collector
from capture.station.results.audit import newest_changes
from capture.station.results.store import ResultStore, open_store
from capture.station.run.events import State
from capture.station.run.live_station import LiveStation
from capture.station.run.run_recipes import RunRecipes
from capture.station.run.self_test import SelfTestFailed
from capture.station.run.station_clock import StationClock
from capture.station.run.station_rig import StationRig
from capture.station.run.triggers import Asker, RecipeRefusal, RecipeRefused
from rig import RigConfig
from tests.capture.station.production import SMALL_RIG, configure, run_parts
from tests.capture.station.results.many import fill, many

KIM = Asker("kim", "engineer")


@pytest.fixture
def opened(station: Path, files: RecipeFolder) -> StationFolder:
    approve(files, "Ada")
    return StationFolder(station)


@pytest.fixture
def store(opened: StationFolder) -> Iterator[ResultStore]:
    with open_store(opened.results, opened.config.name, create=True) as made:
        yield made


@pytest.fixture
def recipes(opened: StationFolder, store: ResultStore) -> RunRecipes:
    recipes = RunRecipes(opened, None, "Ada", store, StationClock())
    recipes.begin(quiet)
    return recipes


def raise_if_cancelled() -> None:
    """Let the work go on."""


def quiet(_: str) -> None:
    """Take a warning."""


def changed(files: RecipeFolder, approver: str | None = "Ada", **values: object) -> None:
    """Give the recipe other values, and approve it."""
    recipe = read_recipe(files.file)
    write_recipe(files.file, type(recipe).model_validate(recipe.model_dump() | values))
    if approver is not None:
        approve(files, approver)


def test_a_changed_recipe_comes_into_force_when_it_is_loaded_again(
    recipes: RunRecipes, files: RecipeFolder, store: ResultStore, opened: StationFolder
) -> None:
    before = recipes.present
    changed(files, note="sheet 7")
    assert recipes.present is before
    wanted = recipes.load("example", KIM, raise_if_cancelled)
    assert recipes.present is before
    assert newest_changes(store, 5) == []  # the self-test may still fail
    recipes.keep(wanted, KIM)
    assert recipes.present.recipe.note == "sheet 7"
    assert recipes.present.loaded_event.by == "kim"
    [change] = newest_changes(store, 5)
    named = [f"example, version 2, {each.recipe.sha256[:8]}" for each in (before, wanted)]
    assert [change.by, change.role, change.what] == ["kim", "engineer", "loaded recipe"]
    assert [change.before, change.after] == named
    assert (opened.path / LAST_RECIPE).is_file()


def test_a_recipe_that_was_changed_since_somebody_saw_it_is_refused(
    recipes: RunRecipes, files: RecipeFolder
) -> None:
    seen = read_recipe(files.file).sha256
    changed(files, note="sheet 7")
    with pytest.raises(RecipeRefused, match="changed by somebody else since you saw it") as refused:
        recipes.load("example", Asker("kim", "engineer", seen), raise_if_cancelled)
    assert refused.value.kind is RecipeRefusal.UNUSABLE
    now = read_recipe(files.file).sha256
    assert (
        recipes.load("example", Asker("kim", "engineer", now), raise_if_cancelled).recipe.sha256
        == now
    )


def test_the_light_of_the_recipe_is_that_of_the_rig(
    recipes: RunRecipes, opened: StationFolder, files: RecipeFolder
) -> None:
    rig = StationRig(opened.config, SMALL_RIG, recipes.present.inspector)
    opening = Mock(wraps=rig.open)
    rig.open = opening  # type: ignore[method-assign]
    rig.open()
    rig.use(recipes.present.inspector)
    assert opening.call_count == 1  # the settings are the same
    recipe = read_recipe(files.file)
    other = type(recipe).model_validate(recipe.model_dump() | {"light": {"exposure_ms": 12.0}})
    rig.use(Collector(other))
    assert opening.call_count == 2
    camera = rig.capture(1)[0].metadata.camera
    rig.close()
    assert camera.exposure_ms == 12.0


@pytest.mark.parametrize(
    ("other", "difference"),
    [
        (SMALL_RIG.model_copy(update={"name": "bench 2"}), "rig 'bench 2' instead of 'rig'"),
        (SMALL_RIG.with_changes(camera={"bits": 10}), "10 bit instead of 12"),
    ],
)
def test_a_rig_that_was_not_taught_fails_the_self_test_and_captures_no_part(
    opened: StationFolder, other: RigConfig, difference: str
) -> None:
    live = LiveStation("line", simulated=True)
    states: list[State] = []
    with pytest.raises(SelfTestFailed, match="not the setting that was taught") as raised:
        run_parts(opened.path, 1, lambda each: states.append(each.state.state), other, live)
    assert difference in str(raised.value)
    assert "teach the recipe again" in str(raised.value)
    assert State.READY not in states


def refusal(recipes: RunRecipes, name: str = "example") -> RecipeRefused:
    present = recipes.present
    with pytest.raises(RecipeRefused) as raised:
        recipes.load(name, KIM, raise_if_cancelled)
    assert recipes.present is present
    return raised.value


def test_a_recipe_that_is_unknown_not_approved_or_damaged_is_refused(
    recipes: RunRecipes, files: RecipeFolder, store: ResultStore
) -> None:
    assert refusal(recipes, "nobody").kind is RecipeRefusal.UNKNOWN
    changed(files, None, note="sheet 7")
    assert refusal(recipes).kind is RecipeRefusal.NOT_APPROVED
    changed(files, calibration={"required": True})
    refused = refusal(recipes)
    assert refused.kind in (RecipeRefusal.UNUSABLE, RecipeRefusal.CHALLENGE)
    assert "calibration" in str(refused)
    changed(files, calibration={"required": False})
    library = files.version(2).library
    library.write_bytes(library.read_bytes()[:-1])
    assert refusal(recipes).kind is RecipeRefusal.UNUSABLE
    files.file.write_text("version = [", encoding="utf-8")
    assert refusal(recipes).kind is RecipeRefusal.UNUSABLE
    assert newest_changes(store, 5) == []


def test_a_recipe_that_fails_its_challenge_is_refused_and_the_part_is_named(
    recipes: RunRecipes, files: RecipeFolder
) -> None:
    [sand] = [name for name, want in challenge_sets(files.challenge).items() if want == "FAIL"]
    add_to_challenge(files.challenge, [files.challenge / sand], "UNKNOWN")
    refused = refusal(recipes)
    assert refused.kind is RecipeRefusal.CHALLENGE
    assert f"{sand} must be UNKNOWN" in str(refused)


def test_a_change_that_cannot_be_recorded_is_not_made(
    recipes: RunRecipes, store: ResultStore, opened: StationFolder
) -> None:
    present = recipes.present
    brass = present.recipe.model_copy(update={"name": "brass"})
    store.close()
    opened.path.joinpath("results.sqlite").unlink()
    opened.path.joinpath("results.sqlite").mkdir()
    with pytest.raises(RecipeRefused) as raised:
        recipes.keep(replace(present, inspector=Collector(brass)), KIM)
    assert raised.value.kind is RecipeRefusal.DATABASE
    assert recipes.present is present
    assert first_recipe(opened) == "example"


def test_the_end_of_a_run_ends_the_replay_and_records_none_of_it(
    recipes: RunRecipes, files: RecipeFolder
) -> None:
    changed(files, note="sheet 7")
    recipes.load("example", KIM, raise_if_cancelled)
    files.replay.unlink()
    begun: list[None] = []

    def stop_at_the_second() -> None:
        begun.append(None)
        if len(begun) == 2:
            raise RecipeRefused("the station stops", RecipeRefusal.NOT_READY)

    with pytest.raises(RecipeRefused, match="the station stops"):
        recipes.load("example", KIM, stop_at_the_second)
    assert not files.replay.exists()


def test_a_last_recipe_that_fails_its_challenge_is_named_with_the_way_out(
    station: Path, files: RecipeFolder, store: ResultStore
) -> None:
    [sand] = [name for name, want in challenge_sets(files.challenge).items() if want == "FAIL"]
    add_to_challenge(files.challenge, [files.challenge / sand], "UNKNOWN")
    configure(station, recipe="brass")
    opened = StationFolder(station)
    keep_recipe(opened, "example")
    said = rf"{sand} must be UNKNOWN.*: remove .*{LAST_RECIPE} to begin with recipe brass$"
    with pytest.raises(ChallengeFailed, match=said):
        RunRecipes(opened, None, "Ada", store, StationClock()).begin(quiet)


def test_a_draft_waits_and_the_approved_recipe_judges(
    opened: StationFolder, store: ResultStore, files: RecipeFolder
) -> None:
    recipes = RunRecipes(opened, None, "Ada", store, StationClock())
    approved = read_recipe(files.file)
    changed(files, None, note="sheet 7")
    warnings: list[str] = []
    recipes.begin(warnings.append)
    assert recipes.present.recipe == approved
    [warning] = warnings
    assert "approve" in warning
    assert approved.version_text in warning


def test_without_any_approved_state_a_draft_ends_the_start(
    station: Path, files: RecipeFolder, store: ResultStore
) -> None:
    for copy in files.version(2).folder.glob("approved-*.toml"):
        copy.unlink()
    changed(files, None, note="sheet 7")
    with pytest.raises(NotApproved):
        RunRecipes(StationFolder(station), None, "Ada", store, StationClock()).begin(quiet)


def test_after_a_roll_back_and_a_draft_the_state_that_judged_last_is_loaded(
    recipes: RunRecipes, store: ResultStore, files: RecipeFolder, opened: StationFolder
) -> None:
    first = read_recipe(files.file)
    changed(files, note="sheet 7")
    later = read_recipe(files.file)
    roll_back(files, first.sha256)
    changed(files, None, note="sheet 8")
    recipes.begin(quiet)
    assert recipes.present.recipe.sha256 == later.sha256
    [part] = many(opened.config.name, 1)
    fill(store, [replace(part, recipe=files.name, recipe_sha256=first.sha256)])
    recipes.begin(quiet)
    assert recipes.present.recipe.sha256 == first.sha256
