"""Changes of a recipe with parts of the history: teaching, and the challenge set."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from capture.station.domain.errors import Conflict, NotFound
from capture.station.domain.verdict import Decision
from capture.station.judge.challenge import Replay
from capture.station.judge.challenge_set import Expected
from capture.station.judge.recipe_changes import RecipeChanges, replay_title, teaching_title
from capture.station.panel.background_jobs import Job, Work
from capture.station.panel.judged_by import stored_set
from capture.station.panel.panel import Panel
from capture.station.panel.security import Denied
from classify.base.errors import InputError
from classify.methods import checked_label

# Number of parts that a job can teach in its time, see `background_jobs`.
MAX_CHOSEN_PARTS = 300


def start_teaching(
    panel: Panel, changes: RecipeChanges, part_ids: Sequence[str], texture: str, *, is_good: bool
) -> Job:
    """Start to teach parts; if none is given, teach those again that were taught before."""
    paths = _set_files(panel, part_ids)
    if paths:
        texture = checked_label(texture)
    elif not changes.files.file.is_file():
        raise Conflict(f"recipe {changes.files.name}: no parts are known; give some")
    bad = None if is_good else texture
    good = texture or None if is_good else None

    def begin() -> Work:
        teaching = changes.teaching(paths, bad, good)
        return lambda show: teaching(show).fields()

    return _start(panel, changes, "teach", teaching_title(len(paths), bad, good), begin)


def start_replay(panel: Panel, changes: RecipeChanges) -> Job:
    """Start a replay of the challenge set; Conflict if a job is running."""

    def begin() -> Work:
        replaying = changes.replaying()
        return lambda show: _fields(replaying(show))

    return _start(panel, changes, "challenge", replay_title(changes.files), begin)


def _fields(replay: Replay) -> dict[str, Any]:
    return {
        "parts": len(replay.parts),
        "regressions": [str(part) for part in replay.regressions],
        "recipe_sha256": replay.fingerprint.recipe_sha256,
    }


def add_parts_to_challenge(
    panel: Panel, changes: RecipeChanges, part_ids: Sequence[str], expected: Expected
) -> None:
    """Add parts to the challenge set."""
    paths = _set_files(panel, part_ids)
    if not paths:
        raise InputError("choose a part")
    changes.add_to_challenge(paths, expected)


def _start(
    panel: Panel, changes: RecipeChanges, kind: str, title: str, begin: Callable[[], Work]
) -> Job:
    return panel.jobs.start(Job(kind, changes.files.name, title, changes.who.name), begin)


def _set_files(panel: Panel, part_ids: Sequence[str]) -> tuple[Path, ...]:
    if len(part_ids) > MAX_CHOSEN_PARTS:
        raise InputError(f"{len(part_ids)} parts: give {MAX_CHOSEN_PARTS} or fewer")
    store, paths = panel.results.store, []
    for part_id in dict.fromkeys(part_ids):
        entry = store.part(part_id)
        if entry is None:
            raise NotFound(f"part {part_id[:100]}: there is no result of it")
        if entry.result.exposed_utc is None or entry.result.verdict.decision is Decision.ERROR:
            raise Conflict(f"part {part_id}: is ERROR; its set cannot be relied on")
        try:
            paths.append(stored_set(panel.folder, entry))
        except Denied as error:
            raise Conflict(str(error)) from error
    return tuple(paths)
