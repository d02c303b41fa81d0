"""`RecipeChanges`: what engineers do to a recipe, each change recorded."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from capture.station.approval import approve, approved_states, require_seen, roll_back
from capture.station.challenge_set import (
    Expected,
    add_to_challenge,
    challenge_sets,
    remove_from_challenge,
)
from capture.station.panel.access.roles import Identity
from capture.station.panel.panel import Panel
from capture.station.panel.part_pictures.stored_set import stored_set
from capture.station.panel.security import Denied
from capture.station.recipe import Recipe
from capture.station.recipe_file import read_recipe
from capture.station.recipe_folder import RecipeFolder
from capture.station.recipe_settings import save_settings, setting_changes, with_settings
from capture.station.recipe_state import RecipeState, state_of
from capture.station.results.history import Selection
from capture.station.verdict import Decision
from classify.errors import InputError
from classify.labels import checked_label
from rig.config.rig import config_of

from .background_jobs import Job, Work
from .recipe_jobs import replay_parts, teach_parts

# As many as a job can teach in its time; see `background_jobs`.
MOST_PARTS = 300
EXPECTED: tuple[Expected, ...] = ("PASS", "FAIL", "UNKNOWN")
_DIGITS = 8


@dataclass(frozen=True)
class RecipeChanges:
    """A recipe, for changes by `who`."""

    panel: Panel
    who: Identity
    files: RecipeFolder

    @property
    def state(self) -> RecipeState:
        """What the recipe lacks; raises InputError if it cannot be read."""
        return state_of(self.files, self._calibration())

    def teach(self, part_ids: Sequence[str], texture: str, *, is_good: bool) -> Job:
        """Start to teach parts, or the known ones again if none is given.

        Raises
        ------
        InputError
            If a part has no set, or the texture cannot be one.
        JobRefused
            If a job is running.
        """
        paths = self._sets(part_ids)
        if paths:
            texture = checked_label(texture)
        elif not self.files.file.is_file():
            raise InputError(f"recipe {self.files.name}: no parts are known; give some")
        kind = "good" if is_good else "bad"
        parts = f"{len(paths)} {kind} part{'s' * (len(paths) != 1)}"
        what = f"{parts} of {texture}" if paths else "the known parts again"
        after = f"teach {what}: {', '.join(part_ids)}" if paths else f"teach {what}"
        title = f"Teach {what}"
        arguments = (self.files, paths, texture, is_good)
        return self._start("teach", title, after, teach_parts, arguments)

    def replay(self) -> Job:
        """Start a replay of the challenge set; raises JobRefused if a job is running."""
        parts = len(challenge_sets(self.files.challenge))
        title = f"Replay the challenge set, {parts} part{'s' * (parts != 1)}"
        return self._start(
            "challenge", title, title, replay_parts, (self.files, self._calibration())
        )

    def add_to_challenge(self, part_ids: Sequence[str], expected: str) -> None:
        """Add parts to the challenge set.

        Raises
        ------
        InputError
            If a part has no set, or the verdict is none that can be expected.
        """
        wanted = next((each for each in EXPECTED if each == expected), None)
        if wanted is None:
            raise InputError(f"expected = {expected[:20]!r}: give {', '.join(EXPECTED)}")
        paths, before = self._sets(part_ids), challenge_sets(self.files.challenge)
        if not paths:
            raise InputError("choose a part")
        for path in paths:
            self._record(f"challenge part {path.name}", before.get(path.name), wanted)
        add_to_challenge(self.files.challenge, paths, wanted)

    def remove_from_challenge(self, file: str) -> None:
        """Take a part out of the challenge set; raises InputError if it is not there."""
        before = challenge_sets(self.files.challenge).get(file)
        if before is None:
            raise InputError(f"{file[:100]!r} is not in the challenge set")
        self._record(f"challenge part {file}", before, None)
        remove_from_challenge(self.files.challenge, file)

    def save_settings(self, seen_sha256: str, values: Mapping[str, Any]) -> Recipe:
        """Give the recipe other settings.

        Raises
        ------
        SettingsRefused
            If a value is wrong.
        RecipeError
            If the recipe was changed since it was seen.
        """
        before = read_recipe(self.files.file)
        require_seen(before, seen_sha256)
        after = with_settings(before, values)
        changes = setting_changes(before, after)
        if not changes:
            return before
        for change in changes:
            self._record(change.key, change.before, change.after)
        save_settings(self.files, after, seen_sha256)
        return after

    def approve(self, seen_sha256: str) -> Recipe:
        """Approve the recipe in the name of who asks.

        Raises
        ------
        RecipeError
            If it cannot judge parts, or was changed since it was seen.
        """
        before = read_recipe(self.files.file)
        require_seen(before, seen_sha256)
        after = f"{_named(before)}, approved by {self.who.name}"
        self._record("", _with_approval(before), after)
        return approve(self.files, self.who.name, seen_sha256)

    def roll_back(self, sha256: str) -> Recipe:
        """Go back to a state that was approved.

        Raises
        ------
        RecipeError
            If there is none with this hash, or what was taught for it was changed since.
        """
        state = next((each for each in approved_states(self.files) if each.sha256 == sha256), None)
        after = sha256[:100] if state is None else _with_approval(state)
        self._record("", _with_approval(read_recipe(self.files.file)), f"roll back to {after}")
        return roll_back(self.files, sha256)

    def _start(
        self, kind: str, title: str, after: str, work: Work, arguments: tuple[Any, ...]
    ) -> Job:
        jobs, name = self.panel.jobs, self.files.name
        jobs.require_free()
        before, known = self._present(), self._recipe()
        self._record("", before, after)

        def ended(job: Job) -> None:
            found = f"{title}: {job.error}" if job.error else self._present()
            if job.kind == "challenge" and not job.error:
                met = job.result["parts"] - len(job.result["regressions"])
                found = f"challenge: {met} of {job.result['parts']} parts got their verdict"
            self._record("", before, found)
            now = self._recipe()
            if known is not None and now is not None:
                for change in setting_changes(known, now):
                    self._record(change.key, change.before, change.after)

        job = Job(kind=kind, recipe=name, title=title, by=self.who.name)
        return jobs.start(job, work, arguments, ended)

    def _recipe(self) -> Recipe | None:
        return read_recipe(self.files.file) if self.files.file.exists() else None

    def _present(self) -> str | None:
        recipe = self._recipe()
        return None if recipe is None else _with_approval(recipe)

    def _record(self, key: str, before: str | None, after: str | None) -> None:
        what = f"recipe {self.files.name}" + (f": {key}" if key else "")
        self.panel.changes.record(self.who, what, before, after)

    def _sets(self, part_ids: Sequence[str]) -> tuple[Path, ...]:
        if len(part_ids) > MOST_PARTS:
            raise InputError(f"{len(part_ids)} parts: give {MOST_PARTS} or fewer")
        folder, store, paths = self.panel.folder, self.panel.results.store, []
        for part_id in dict.fromkeys(part_ids):
            entry = next(store.parts(Selection(part_id=part_id)), None)
            if entry is None:
                raise InputError(f"part {part_id[:100]}: there is no result of it")
            if entry.result.exposed_utc is None or entry.result.verdict.decision is Decision.ERROR:
                raise InputError(f"part {part_id}: is ERROR; its set cannot be relied on")
            try:
                paths.append(stored_set(folder, entry))
            except Denied as error:
                raise InputError(str(error)) from error
        return tuple(paths)

    def _calibration(self) -> Path | None:
        folder = self.panel.folder
        calibration = config_of(folder.config.rig_in(folder.path)).calibration
        return None if calibration is None else Path(calibration)


def _named(recipe: Recipe) -> str:
    return f"version {recipe.version}, {recipe.sha256[:_DIGITS]}"


def _with_approval(recipe: Recipe) -> str:
    approval = recipe.approval
    by = f"approved by {approval.by}" if approval and recipe.is_approved else "not approved"
    return f"{_named(recipe)}, {by}"
