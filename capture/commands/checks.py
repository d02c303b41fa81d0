"""Print the checks of a doctor; the exit status says whether one found a fault."""

from collections.abc import Sequence
from dataclasses import asdict

import typer

from capture.base.console import new_table, out, print_json, print_table
from rig.doctor.check import Check

_FAULT_STATUS = 1
_STYLES = {"ok": "green", "warning": "yellow", "fault": "bold red", "unknown": "dim"}


def print_checks(checks: Sequence[Check], *, as_json: bool) -> None:
    """Print checks as a table or as JSON, and exit with status 1 if one found a fault."""
    from rich.text import Text

    counts = {
        status: sum(check.status == status for check in checks)
        for status in ("fault", "warning", "unknown")
    }
    if as_json:
        print_json({"checks": [asdict(check) for check in checks], **counts})
    else:
        table = new_table("what", "status", "seen", prose="seen")
        for check in checks:
            seen = Text(check.seen)
            if check.advice:
                seen.append("\n-> " + check.advice, style="bold")
            table.add_row(check.name, Text(check.status, style=_STYLES[check.status]), seen)
        print_table(table)
        out.print(", ".join(f"{status}: {count}" for status, count in counts.items()))
    if counts["fault"]:
        raise typer.Exit(_FAULT_STATUS)
