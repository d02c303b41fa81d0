"""``ps4rig rig doctor``."""

from collections.abc import Sequence
from dataclasses import asdict
from functools import partial
from typing import Annotated

import typer

from capture.base.console import new_table, out, print_json, print_table, reported
from capture.commands import options
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
            finding = Text(check.seen)
            if check.advice:
                finding.append("\n-> " + check.advice, style="bold")
            table.add_row(check.name, Text(check.status, style=_STYLES[check.status]), finding)
        print_table(table)
        out.print(", ".join(f"{status}: {count}" for status, count in counts.items()))
    if counts["fault"]:
        raise typer.Exit(_FAULT_STATUS)


@reported
def doctor(
    rig: options.Rig = "rig.toml",
    has_sheet: Annotated[
        bool,
        typer.Option(
            "--sheet",
            help="A white matt sheet is below the camera: compare LEDs, lights, camera and lens "
            "with the calibration of the rig. A simulated rig does so anyway.",
        ),
    ] = False,
    as_json: options.Json = False,
) -> None:
    """Check the whole rig; print each finding, and a remedy for each fault.

    It checks ports, permissions, controller, watchdog, camera, frames, and an image under each
    LED: put a surface with relief below the camera, or a white sheet with --sheet. The exit status
    is 1 if there is a fault.
    """
    from capture.procedures.rig_check import check_calibration
    from rig.doctor.diagnosis import diagnose

    further = partial(check_calibration, has_sheet=has_sheet)
    print_checks(list(diagnose(rig, further=further)), as_json=as_json)
