"""``ps4rig session status``."""

from pathlib import Path
from typing import Annotated

import typer

from capture.commands import options
from capture.console import new_table, out, print_json, print_table, reported


@reported
def status(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of the session.")],
    json: options.Json = False,
) -> None:
    """Show what a session has captured, and what is missing."""
    from capture.session.folder import read_session

    session = read_session(folder)
    missing = session.missing()
    planned = [session.journal.entry_of(each) for each in session.plan.sets()]
    entries = [entry for entry in planned if entry is not None]
    skipped = [entry for entry in entries if entry.skipped is not None]
    warned = [entry for entry in entries if entry.measures and entry.measures.warnings]
    if json:
        print_json(
            {
                "session": str(folder),
                "planned": len(session.plan),
                "missing": [
                    {"specimen": each.specimen, "orientation_deg": each.orientation_deg,
                     "repeat": each.repeat}
                    for each in missing
                ],
                "skipped": [entry.model_dump(mode="json") for entry in skipped],
                "warned": [entry.model_dump(mode="json") for entry in warned],
                "runs": [run.model_dump(mode="json") for run in session.journal.runs],
            }
        )  # fmt: skip
        return
    out.print(
        f"{folder}: {len(session.plan)} sets planned, "
        f"{len(session.plan) - len(missing) - len(skipped)} captured, {len(skipped)} left out, "
        f"{len(missing)} missing",
        soft_wrap=True,
    )
    table = new_table("specimen", "captured", "missing at degrees", prose="missing at degrees")
    for specimen in session.plan.specimen:
        angles = dict.fromkeys(
            f"{each.orientation_deg:g}" for each in missing if each.specimen == specimen.id
        )
        captured = sum(
            (session.path / entry.file).is_file()
            for entry in entries
            if entry.file is not None and entry.specimen == specimen.id
        )
        table.add_row(specimen.id, str(captured), ", ".join(angles) or "-")
    print_table(table)
    for run in session.journal.runs:
        ended = run.ended_utc or "was killed, or still runs"
        out.print(
            f"run {run.started_utc} to {ended}: {run.finish or '-'}"
            + (f" ({run.reason})" if run.reason else ""),
            soft_wrap=True,
        )
    for entry in warned:
        assert entry.measures is not None
        out.print(f"{entry.file}: {'; '.join(entry.measures.warnings)}", soft_wrap=True)
