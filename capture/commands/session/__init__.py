"""``ps4rig session``: one file for each group of commands, registered here."""

from capture.base.console import command_group

from . import new, report, run, status

__all__ = ["session_app"]

session_app = command_group(
    "Capture many sets by a plan, and go on where a session was interrupted."
)
session_app.command()(new.new)
session_app.command()(run.run)
session_app.command()(status.status)
session_app.command()(run.resume)
session_app.command()(report.report)
