"""`RecipeChanges`: changes of a recipe, each recorded."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from capture.base.console import ShowProgress
from capture.station.domain.errors import error_text
from capture.station.domain.folder import StationFolder
from capture.station.domain.recipe import Recipe
from capture.station.domain.recipe_file import RecipeFolder, read_recipe
from capture.station.domain.users import Identity
from capture.station.results.audit import ResultsAccess, changing_on_the_terminal
from capture.station.results.database import ResultsUnavailable

from .approval import approve, approved_states, require_unchanged, roll_back
from .challenge import Replay, run_challenge
from .challenge_set import Expected, add_to_challenge, challenge_sets, remove_from_challenge
from .inspector import Inspector
from .recipe_settings import save_settings, setting_changes
from .recipe_state import RecipeState, state_of
from .teaching.teaching import teach
from .teaching.teaching_result import Teaching

_T = TypeVar("_T")


@dataclass(frozen=True)
class RecipeChanges:
    """A recipe for changes by `who`; nothing changes if a change cannot be recorded."""

    folder: StationFolder
    results: ResultsAccess
    who: Identity
    files: RecipeFolder

    @property
    def calibration(self) -> str | None:
        """Calibration of the rig; None for a rig without one."""
        return self.folder.rig_config().calibration

    @property
    def state(self) -> RecipeState:
        """State of the recipe; raises InputError if it cannot be read."""
        return state_of(self.files, self.calibration)

    def add_to_challenge(self, paths: Sequence[Path], expected: Expected) -> None:
        """Add sets to the challenge set."""
        add_to_challenge(self.files.challenge, paths, expected, self._record_part)

    def remove_from_challenge(self, file: str) -> None:
        """Take a part out of the challenge set; raises InputError if it is not there."""
        remove_from_challenge(self.files.challenge, file, self._record_part)

    def save_settings(self, shown_sha256: str, values: Mapping[str, Any]) -> None:
        """Change settings of the recipe, unless its hash is no longer `shown_sha256`."""
        save_settings(self.files, values, shown_sha256, self._record_settings)

    def approve(self, by: str, shown_sha256: str | None = None) -> Recipe:
        """Approve the recipe, unless `by` has approved it already.

        The recorded change lists the settings that differ from the last approved state.
        """
        present = read_recipe(self.files.file)
        if present.is_approved and present.approval is not None and present.approval.by == by:
            require_unchanged(present, shown_sha256)
            return present
        last = next(iter(approved_states(self.files)), None)

        def record(old: Recipe, new: Recipe) -> None:
            changes = [] if last is None else setting_changes(last, new)
            differences = ", ".join(map(str, changes))
            since = f"; since the last approval: {differences}" if differences else ""
            self._record("", with_approval(old), f"{with_approval(new)}{since}")

        return approve(self.files, by, shown_sha256, record)

    def roll_back(self, sha256: str) -> Recipe:
        """Replace the recipe by an approved state of it."""

        def record(old: Recipe, new: Recipe) -> None:
            self._record("", with_approval(old), f"roll back to {with_approval(new)}")

        return roll_back(self.files, sha256, record)

    def teaching(
        self,
        paths: Sequence[Path],
        bad_texture: str | None,
        good_texture: str | None = None,
        *,
        is_relabelling: bool = False,
        removed: Sequence[str] = (),
    ) -> Callable[[ShowProgress], Teaching]:
        """Record that a teaching begins; return the function that does it, see `teach`."""
        title = teaching_title(len(paths), bad_texture, good_texture)
        listed = f": {', '.join(path.name for path in paths)}" if paths else ""
        listed += f"; without {', '.join(removed)}" if removed else ""

        def work(show: ShowProgress) -> Teaching:
            return teach(
                self.files,
                paths,
                bad_texture,
                good_texture=good_texture,
                is_relabelling=is_relabelling,
                removed=removed,
                show=show,
            )

        return self._recorded_work(title, f"{title[0].lower()}{title[1:]}{listed}", work)

    def replaying(self) -> Callable[[ShowProgress], Replay]:
        """Record that a replay of the challenge set begins; return the function that does it."""

        def work(show: ShowProgress) -> Replay:
            return run_challenge(self.files, Inspector.load(self.files, self.calibration), show)

        def outcome(replay: Replay) -> str:
            parts, regressions = len(replay.parts), len(replay.regressions)
            return f"challenge: {parts - regressions} of {parts} parts got the expected verdict"

        title = replay_title(self.files)
        return self._recorded_work(title, title, work, outcome)

    def _recorded_work(
        self,
        title: str,
        begin_text: str,
        work: Callable[[ShowProgress], _T],
        outcome_of: Callable[[_T], str] = lambda _: "",
    ) -> Callable[[ShowProgress], _T]:
        """Record that `work` begins; return a function that does it.

        The function records the outcome of `work`, or the new recipe.
        """
        recipe_before = self._recipe()
        before = None if recipe_before is None else with_approval(recipe_before)
        self._record("", before, begin_text)

        def recorded(show: ShowProgress) -> _T:
            outcome = ""
            try:
                value = work(show)
                outcome = outcome_of(value)
                return value
            except BaseException as error:
                outcome = f"{title}: {error_text(error)}"
                raise
            finally:
                recipe_after = self._recipe()
                try:
                    after = None if recipe_after is None else with_approval(recipe_after)
                    self._record("", before, outcome or after)
                    if recipe_before is not None and recipe_after is not None:
                        self._record_settings(recipe_before, recipe_after)
                except ResultsUnavailable as error:  # its message says that nothing was changed
                    raise ResultsUnavailable(
                        f"{title}: ended, but the log of changes lacks its end: {error.__cause__}"
                    ) from error

        return recorded

    def _recipe(self) -> Recipe | None:
        return read_recipe(self.files.file) if self.files.file.exists() else None

    def _record_settings(self, before: Recipe, after: Recipe) -> None:
        for change in setting_changes(before, after):
            self._record(change.key, change.before, change.after)

    def _record_part(self, file: str, before: str | None, after: str | None) -> None:
        self._record(f"challenge part {file}", before, after)

    def _record(self, key: str, before: str | None, after: str | None) -> None:
        what = f"recipe {self.files.name}" + (f": {key}" if key else "")
        self.results.record(self.who, what, before, after)


def teaching_title(parts: int, bad_texture: str | None, good_texture: str | None) -> str:
    """Return the title of a teaching, as people see it."""
    kind, texture = "bad" if bad_texture else "good", bad_texture or good_texture
    if parts == 0:
        return "Teach the known parts again"
    return f"Teach {parts} {kind} part{'s' * (parts != 1)}{f' of {texture}' if texture else ''}"


def replay_title(files: RecipeFolder) -> str:
    """Return the title of a replay, as people see it."""
    parts = len(challenge_sets(files.challenge))
    return f"Replay the challenge set, {parts} part{'s' * (parts != 1)}"


@contextmanager
def recipe_on_the_terminal(
    station: Path, recipe: str | None, by: str | None
) -> Iterator[RecipeChanges]:
    """Yield a recipe for changes that are recorded under `by` and the user of this shell."""
    folder = StationFolder(station)
    files = folder.recipe_files(recipe)
    with changing_on_the_terminal(folder, by) as (results, who):
        yield RecipeChanges(folder, results, who, files)


def with_approval(recipe: Recipe) -> str:
    """Return version and hash of a recipe, and who approved it."""
    approval = recipe.approval
    by = f"approved by {approval.by}" if approval and recipe.is_approved else "not approved"
    return f"{recipe.version_text}, {by}"
