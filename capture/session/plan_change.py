"""A plan or a rig that was changed between two runs of a session."""

import json
import os
import shutil
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from capture.maps.comparison import field_differences
from classify.base.durable_file import durable_file
from classify.base.errors import InputError
from classify.base.models import read_toml
from rig import RigConfig

from .folder import PLAN, SETS, SessionFolder
from .journal import Journal, SetEntry
from .plan import SessionPlan, read_plan

# Fields that add and remove planned sets; captured sets do not depend on them.
_PLANNING_FIELDS = ("orientations_deg", "repeats", "file_name", "turntable", "turntable_timeout_s")


def plan_beside(folder: Path) -> Path | None:
    """Return the plan beside the folder of a session that names it; None if there is none."""
    folder = Path(os.path.normpath(folder.absolute()))  # links are not resolved, as in `run`
    plans = [path for path in sorted(folder.parent.glob("*.toml")) if _names(path, folder.name)]
    if len(plans) > 1:
        raise InputError(
            f"{', '.join(path.name for path in plans)}: each is a plan of {folder.name}; take one "
            "with ps4rig session run PLAN --new-plan"
        )
    return plans[0] if plans else None


def _names(path: Path, session: str) -> bool:
    """Whether a TOML file is a plan of `session`; a damaged file is judged by its own name."""
    try:
        return bool(read_toml(path, "").get("name") == session)
    except InputError:
        return path.stem == session


def plan_changes(plan: SessionPlan, folder: SessionFolder) -> list[str]:
    """Describe the changes of a plan, and their consequences for the captured sets."""
    if plan == folder.plan:
        return []
    captured = Counter(entry.specimen for entry in folder.captured())
    before, after = (plan_version.model_dump(mode="json") for plan_version in (folder.plan, plan))
    old, new = (
        {specimen["id"]: specimen for specimen in values.pop("specimen")}
        for values in (before, after)
    )
    lines = []
    for line, field in _changes(before, after):
        lines.append(line + _unchanged(captured.total() * (field not in _PLANNING_FIELDS)))
    for name in dict.fromkeys([*old, *new]):
        if name not in old or name not in new:
            lines.append(f"specimen {name}: " + ("new" if name in new else "removed"))
            continue
        for line, _ in _changes(old[name], new[name]):
            lines.append(f"specimen {name}: {line}" + _unchanged(captured[name]))
    return [*(lines or ["the order of the specimens"]), *unplanned_text(folder.unplanned(plan))]


def _changes(before: Mapping[str, Any], after: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Each field that differs as a line with both values, and its name."""
    for field, *values in field_differences(before, after):
        first, second = (
            "none" if value is None else json.dumps(value, ensure_ascii=False) for value in values
        )
        yield f"{field}: {first} -> {second}", field


def _unchanged(captured: int) -> str:
    return f"; unchanged in the captured sets ({captured})" if captured else ""


def unplanned_text(entries: Iterable[SetEntry]) -> list[str]:
    """Name captured sets that are no longer planned in one line, if there are any."""
    angles_of: dict[str, list[str]] = {}
    for entry in entries:
        repeat = f" ({entry.repeat})" if entry.repeat > 1 else ""
        angles_of.setdefault(entry.specimen, []).append(f"{entry.orientation_deg:g}{repeat}")
    text = "; ".join(f"{name} at {', '.join(angles)}" for name, angles in angles_of.items())
    return [f"captured and no longer planned, but kept: {text}"] if text else []


def use_plan(plan_path: Path, folder: SessionFolder) -> None:
    """Replace the plan of a session; entries of sets that are no longer planned are kept."""
    plan = read_plan(plan_path)
    files = {entry.file.casefold(): entry for entry in folder.journal.entries if entry.file}
    for planned in plan.sets():
        entry = files.get(f"{SETS}/{planned.file_name}".casefold())
        if entry is not None and folder.journal.entry_of(planned) is not entry:
            raise InputError(
                f"{plan_path}: {planned} would be {entry.file}, which is {entry.specimen} at "
                f"{entry.orientation_deg:g} degrees; give another id, or another file_name"
            )
    with durable_file(folder.path / PLAN) as temporary:
        shutil.copyfile(plan_path, temporary)
    folder.plan = plan
    folder.write_table()


def rig_settings(config: RigConfig) -> dict[str, Any]:
    """Return the settings of a rig that its sets depend on."""
    return config.model_dump(mode="json", include={"name", "calibration", "lights", "camera"})


def rig_changes(journal: Journal, config: RigConfig) -> list[str]:
    """Describe the differences of a rig from the rig of the last run."""
    if not journal.runs:
        return []
    return [line for line, _ in _changes(journal.runs[-1].settings, rig_settings(config))]
