"""``ps4rig session``: its commands are registered here."""

from capture.base.console import command_group

from . import report, run

__all__ = ["session_app"]

session_app = command_group(
    "Capture many sets by a plan, and go on where a session was interrupted."
)
session_app.command()(run.new)
session_app.command()(run.run)
session_app.command()(report.status)
session_app.command()(run.resume)
session_app.command()(report.report)
