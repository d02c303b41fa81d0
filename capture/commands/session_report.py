"""Commands that read a session: session status, session report."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from capture.base.console import new_table, out, print_json, print_table, progress, progress_bar
from capture.base.utc_time import readable_utc
from capture.commands import options
from classify.base.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from capture.session.folder import SessionFolder
    from capture.session.plan import PlannedSet


def status(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of the session.")],
    json: options.Json = False,
) -> None:
    """Show what a session has captured, and what is missing; each set is read and hashed."""
    from capture.session.folder import read_session
    from capture.session.plan_change import unplanned_text

    from .session_terminal import left_out_text

    session = read_session(folder)
    not_captured = set(session.missing())
    read = progress(session.read_again(), len(session.plan) - len(not_captured), "sets")
    problems = {planned: result for planned, result in read if isinstance(result, str | InputError)}
    damaged = {planned: reason for planned, reason in problems.items() if isinstance(reason, str)}
    unreadable = {planned: error for planned, error in problems.items() if planned not in damaged}
    missing = [
        planned for planned in session.plan.sets() if planned in not_captured or planned in damaged
    ]
    entries = map(session.journal.entry_of, session.plan.sets())
    left_out = session.left_out()
    warned = [entry for entry in entries if entry and entry.measures and entry.measures.warnings]
    if json:
        print_json(
            {
                "session": str(folder),
                "planned": len(session.plan),
                "missing": [_as_json(planned) for planned in missing],
                "damaged": [
                    {**_as_json(planned), "reason": reason} for planned, reason in damaged.items()
                ],
                "unreadable": [
                    {**_as_json(planned), "reason": str(error)}
                    for planned, error in unreadable.items()
                ],
                "skipped": [entry.model_dump(mode="json") for entry in left_out],
                "unplanned": [entry.model_dump(mode="json") for entry in session.unplanned()],
                "warned": [entry.model_dump(mode="json") for entry in warned],
                "runs": [run.model_dump(mode="json") for run in session.journal.runs],
            }
        )  # fmt: skip
        return
    _print_counts(session, missing)
    for line in unplanned_text(session.unplanned()):
        out.print(line)
    for entry in left_out:
        planned = session.plan.planned(*entry.key)
        out.print(f"{planned}: {entry.skipped}")
    if left_out:
        out.print(left_out_text(session))
    for planned, reason in damaged.items():
        out.print(f"{planned}: its file is damaged: {reason}")
    for planned, error in unreadable.items():
        out.print(f"{planned}: {error}")
    for entry in warned:
        assert entry.measures is not None
        out.print(f"{entry.file}: {'; '.join(entry.measures.warnings)}")


def _print_counts(session: SessionFolder, missing: Sequence[PlannedSet]) -> None:
    """Print the numbers of sets, in all and of each specimen, and the runs."""
    plan_size, left_out = len(session.plan), len(session.left_out())
    captured = plan_size - len(missing) - left_out
    out.print(
        f"{session.path}: {plan_size} sets planned, {captured} captured, "
        f"{left_out} left out, {len(missing)} missing",
    )
    table = new_table("specimen", "captured", "missing at degrees", prose="missing at degrees")
    for specimen in session.plan.specimen:
        missing_of_specimen = [planned for planned in missing if planned.specimen == specimen.id]
        angles = dict.fromkeys(f"{planned.orientation_deg:g}" for planned in missing_of_specimen)
        entries = (
            session.journal.entry_of(planned_set)
            for planned_set in session.plan.sets()
            if planned_set.specimen == specimen.id and planned_set not in missing
        )
        count = sum(entry is not None and entry.file is not None for entry in entries)
        table.add_row(specimen.id, str(count), ", ".join(angles) or "-")
    print_table(table)
    for run in session.journal.runs:
        ended = ", killed or still running"
        if run.ended_utc is not None:
            ended = f" to {readable_utc(run.ended_utc)}"
        out.print(
            f"run {readable_utc(run.started_utc)}{ended}: {run.finish or '-'}"
            + (f" ({run.reason})" if run.reason else ""),
        )


def _as_json(planned: PlannedSet) -> dict[str, Any]:
    return {
        "specimen": planned.specimen,
        "orientation_deg": planned.orientation_deg,
        "repeat": planned.repeat,
    }


def report(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of the session.")],
    json: options.Json = False,
) -> None:
    """Write DIR/report.html: specimens, levels, orientations, and how the textures separate.

    A damaged set is named, also in DIR/sets.csv, and the others are reported.
    """
    from capture.session.folder import REPORT, read_session, session_folder
    from capture.session.report_analysis import analyse
    from capture.session.report_page import report_page
    from classify.base.durable_file import write_text

    session = read_session(folder)
    path = folder / REPORT
    with progress_bar(1, "report") as show_share:
        analysis = analyse(session, show_share)
    write_text(path, report_page(session, analysis))
    try:
        with session_folder(folder) as opened:
            opened.write_table(analysis.damaged)
    except InputError as error:
        if not isinstance(error.__cause__, BlockingIOError):
            raise  # a session in use keeps its table itself
    if json:
        print_json(
            {
                "report": str(path),
                "sets": len(analysis.entries),
                "damaged": [
                    {"set": file, "error": error} for file, error in analysis.damaged.items()
                ],
                "remarks": [{"set": file, "remark": remark} for file, remark in analysis.remarks],
            }
        )
        return
    for file, damage in analysis.damaged.items():
        out.print(f"{file}: cannot be read: {damage}")
    for file, remark in analysis.remarks:
        out.print(f"{file}: {remark}")
    out.print(f"{path}: {len(analysis.entries)} sets")
