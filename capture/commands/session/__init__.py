"""``ps4rig session``: one file for each group of commands, registered here."""

import typer

from . import new, report, run, status

__all__ = ["session_app"]

session_app = typer.Typer()
session_app.command()(new.new)
session_app.command()(run.run)
session_app.command()(status.status)
session_app.command()(run.resume)
session_app.command()(report.report)


@session_app.callback(invoke_without_command=True)
def _options(context: typer.Context) -> None:
    """Capture many sets by a plan, and go on where a session was interrupted."""
    if context.invoked_subcommand is None:
        print(context.get_help())
