"""`RunRecipes`: the present recipe of a run, and the loading of others."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from capture.calibration.lookup import FoundCalibration, keep_beside
from capture.sets.captured_set import CapturedSet
from capture.station.domain.errors import ChallengeFailed, NotApproved, error_text
from capture.station.domain.folder import LAST_RECIPE, StationFolder, first_recipe, keep_recipe
from capture.station.domain.recipe import Recipe, require_approved
from capture.station.domain.recipe_file import RecipeFolder, read_recipe
from capture.station.judge.approval import approved_states, require_unchanged
from capture.station.judge.challenge import require_challenge
from capture.station.judge.inspector import Collector, Inspector
from capture.station.results.audit import record_change
from capture.station.results.history import Selection
from capture.station.results.store import ResultStore
from classify.base.durable_file import make_folder
from classify.base.errors import InputError, Ps4rigError
from rig.doctor.check import Check

from .events import RecipeLoaded
from .outcome import PartJudge
from .self_test import check_calibration_age, require_no_fault
from .station_clock import StationClock
from .triggers import Asker, RecipeRefusal, RecipeRefused

_REFUSAL_OF_ERROR: tuple[tuple[type[Exception], RecipeRefusal], ...] = (
    (NotApproved, RecipeRefusal.NOT_APPROVED),
    (ChallengeFailed, RecipeRefusal.CHALLENGE),
    (Ps4rigError, RecipeRefusal.UNUSABLE),
)


@dataclass(frozen=True, eq=False)
class UsableRecipe:
    """A recipe that may judge parts: approved, loaded, with its challenge set met."""

    judge: PartJudge
    inspector: Inspector | Collector
    by: str = ""  # who asked for it; empty for the recipe of the start

    @property
    def recipe(self) -> Recipe:
        """The recipe."""
        return self.inspector.recipe

    @cached_property
    def loaded_event(self) -> RecipeLoaded:
        """The event that announces the recipe when it is put into use."""
        return RecipeLoaded(self.recipe.name, self.recipe.version, self.recipe.sha256, self.by)

    def checks(self) -> list[Check]:
        """Return the checks of the calibration."""
        return list(check_calibration_age(self.inspector.calibration, self.recipe.calibration))


class RunRecipes:
    """The present recipe of a run, and others that it can load, each with its `PartJudge`.

    `begin` or `collect` gives the present one. `load` may be called while parts are inspected, all
    other methods only between parts.
    """

    present: UsableRecipe

    def __init__(
        self,
        folder: StationFolder,
        calibration: str | None,
        operator: str | None,
        store: ResultStore,
        clock: StationClock,
    ) -> None:
        self._folder, self._calibration = folder, calibration
        self._operator, self._store, self._clock = operator, store, clock

    def begin(self, warn: Callable[[str], None]) -> None:
        """Load the recipe with which a run begins; a draft waits for its approval."""
        name, configured = first_recipe(self._folder), self._folder.config.recipe
        files = self._folder.recipe_files(name)
        try:
            try:
                self.present = self._usable(files)
            except NotApproved as error:
                approved = _approved_recipe(files, self._store)
                if approved is None:
                    raise
                warn(f"{error}; until then the approved {approved.version_text} judges")
                self.present = self._usable(files, approved=approved)
        except (InputError, ChallengeFailed) as error:
            if name == configured:
                raise
            path = self._folder.path / LAST_RECIPE
            raise type(error)(
                f"{error}; it was loaded last: remove {path} to begin with recipe {configured}"
            ) from error

    def collect(self) -> None:
        """Begin with a recipe that judges nothing; an existing one gives exposure and gain."""
        files = self._folder.recipe_files(first_recipe(self._folder))
        exists = files.file.exists()
        recipe = read_recipe(files.file) if exists else Recipe(name=files.name, passes=())
        collector = Collector(recipe, FoundCalibration.of_rig(self._calibration))
        self.present = UsableRecipe(self._judge(collector, {}), collector)

    def load(self, name: str, by: Asker, raise_if_cancelled: Callable[[], None]) -> UsableRecipe:
        """Load a recipe, or raise RecipeRefused.

        `raise_if_cancelled` is called before every part of the challenge.
        """
        try:
            files = self._folder.recipe_files(name)
            if not files.file.is_file():
                raise RecipeRefused(f"recipe {name}: no such recipe", RecipeRefusal.UNKNOWN)
            usable = self._usable(files, by.name, raise_if_cancelled)
            require_unchanged(usable.recipe, by.shown_sha256)
            require_no_fault(usable.checks())
        except RecipeRefused:
            raise
        except Exception as error:
            kinds = (kind for errors, kind in _REFUSAL_OF_ERROR if isinstance(error, errors))
            kind = next(kinds, RecipeRefusal.UNFORESEEN)
            raise RecipeRefused(error_text(error), kind) from error
        return usable

    def keep(self, recipe: UsableRecipe, by: Asker) -> None:
        """Record and use a recipe, with which the next run begins; or raise RecipeRefused."""
        before, after = self.present.recipe, recipe.recipe
        try:
            keep_recipe(self._folder, after.name)
            try:
                record_change(
                    self._store,
                    "loaded recipe",
                    f"{before.name}, {before.version_text}",
                    f"{after.name}, {after.version_text}",
                    by=by.name,
                    role=by.role,
                    via=by.via,
                )
            except Exception:
                keep_recipe(self._folder, before.name)
                raise
        except Exception as error:
            raise RecipeRefused(error_text(error), RecipeRefusal.DATABASE) from error
        self.present = recipe

    def _usable(
        self,
        files: RecipeFolder,
        by: str = "",
        raise_if_cancelled: Callable[[], None] = lambda: None,
        approved: Recipe | None = None,
    ) -> UsableRecipe:
        """Load a recipe, or its state `approved`, and require that it meets its challenge."""
        inspector = Inspector.of(approved or read_recipe(files.file), files, self._calibration)
        recipe, fingerprint = inspector.recipe, inspector.fingerprint
        require_approved(recipe)
        require_challenge(files, inspector, raise_if_cancelled)
        fields = {
            "recipe": recipe.name,
            "recipe_version": recipe.version,
            "recipe_sha256": fingerprint.recipe_sha256,
            "library_sha256": fingerprint.library_sha256,
            "calibration_sha256": fingerprint.calibration_sha256,
        }
        return UsableRecipe(self._judge(inspector, fields), inspector, by)

    def _judge(self, inspector: Inspector | Collector, fields: dict[str, Any]) -> PartJudge:
        def save(captured: CapturedSet, set_file: str) -> None:
            """Write the set of a part, with its calibration beside it."""
            path = self._folder.path / set_file
            if path.exists():
                raise InputError(f"{path}: exists, and is not replaced; move it elsewhere")
            make_folder(path.parent)
            if inspector.calibration is not None:
                keep_beside(inspector.calibration.file, path)
            # `home` is not the folder of the day, which may contain many sets.
            captured.save(path, home=path.parent.parent)

        name = self._folder.config.name
        return PartJudge(name, self._operator, inspector, fields, save, self._clock)


def _approved_recipe(files: RecipeFolder, store: ResultStore) -> Recipe | None:
    """Return the approved state that judged the last part, else the last approved state, or None.

    They differ after a roll-back.
    """
    approved = {state.sha256: state for state in approved_states(files)}
    judged = next(store.parts(Selection(recipe=files.name), newest=1), None)
    last = None if judged is None else approved.get(judged.result.recipe_sha256 or "")
    return last or next(iter(approved.values()), None)
