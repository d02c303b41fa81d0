"""Changes of a recipe with parts of the history: teaching, and the challenge set."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from capture.base.console import ShowProgress
from capture.station.domain.errors import Conflict, NotThere
from capture.station.domain.verdict import Decision
from capture.station.judge.challenge import run_challenge
from capture.station.judge.challenge_set import Expected
from capture.station.judge.inspector import Inspector
from capture.station.judge.recipe_changes import LongChange, RecipeChanges
from capture.station.judge.teaching.teaching import teach
from capture.station.panel.background_jobs import Job, Work
from capture.station.panel.panel import Panel
from capture.station.panel.part_pictures.judged_by import stored_set
from capture.station.panel.security import Denied
from classify.base.errors import InputError
from classify.methods import checked_label

# A job can teach this many in its time; see `background_jobs`.
MOST_CHOSEN_PARTS = 300


def start_teaching(
    panel: Panel, changes: RecipeChanges, part_ids: Sequence[str], texture: str, *, is_good: bool
) -> Job:
    """Start to teach parts, or the known ones again if none is given."""
    paths = _sets(panel, part_ids)
    if paths:
        texture = checked_label(texture)
    elif not changes.files.file.is_file():
        raise Conflict(f"recipe {changes.files.name}: no parts are known; give some")
    panel.jobs.require_free()
    change = changes.begin_teaching(part_ids, texture, is_good=is_good)
    bad, good = (None, texture or None) if is_good else (texture, None)

    def work(show: ShowProgress) -> dict[str, Any]:
        return teach(changes.files, paths, bad, good_texture=good, show=show).fields()

    return _start(panel, changes, "teach", change, work)


def start_replay(panel: Panel, changes: RecipeChanges) -> Job:
    """Start a replay of the challenge set; Conflict if a job is running."""
    panel.jobs.require_free()
    change, calibration = changes.begin_replay(), changes.calibration

    def work(show: ShowProgress) -> dict[str, Any]:
        replay = run_challenge(changes.files, Inspector.load(changes.files, calibration), show)
        return {
            "parts": len(replay.parts),
            "regressions": [str(part) for part in replay.regressions],
            "recipe_sha256": replay.fingerprint.recipe_sha256,
        }

    return _start(panel, changes, "challenge", change, work)


def add_parts_to_challenge(
    panel: Panel, changes: RecipeChanges, part_ids: Sequence[str], expected: Expected
) -> None:
    """Add parts to the challenge set."""
    paths = _sets(panel, part_ids)
    if not paths:
        raise InputError("choose a part")
    changes.add_to_challenge(paths, expected)


def _start(panel: Panel, changes: RecipeChanges, kind: str, change: LongChange, work: Work) -> Job:
    def ended(job: Job) -> None:
        if job.error:
            change.failed(job.error)
        elif job.kind == "challenge":
            parts, missed = job.result["parts"], len(job.result["regressions"])
            change.ended(f"challenge: {parts - missed} of {parts} parts got their verdict")
        else:
            change.ended(None)

    job = Job(kind=kind, recipe=changes.files.name, title=change.title, by=changes.who.name)
    with change.recording_failure():  # another job may have started since `require_free`
        return panel.jobs.start(job, work, ended)


def _sets(panel: Panel, part_ids: Sequence[str]) -> tuple[Path, ...]:
    if len(part_ids) > MOST_CHOSEN_PARTS:
        raise InputError(f"{len(part_ids)} parts: give {MOST_CHOSEN_PARTS} or fewer")
    store, paths = panel.results.store, []
    for part_id in dict.fromkeys(part_ids):
        entry = store.part(part_id)
        if entry is None:
            raise NotThere(f"part {part_id[:100]}: there is no result of it")
        if entry.result.exposed_utc is None or entry.result.verdict.decision is Decision.ERROR:
            raise Conflict(f"part {part_id}: is ERROR; its set cannot be relied on")
        try:
            paths.append(stored_set(panel.folder, entry))
        except Denied as error:
            raise Conflict(str(error)) from error
    return tuple(paths)
