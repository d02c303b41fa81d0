"""The command ``ps4rig``.

What a command needs is imported where it runs: ``--help`` is to be there at once.
"""

from __future__ import annotations

import logging
import os
import sys
from importlib.metadata import version
from typing import Annotated

import typer

from classify.errors import InputError

from .commands import bench, demo, reproduce, sets, textures
from .commands.rig import rig_app
from .console import INTERRUPTED_STATUS, describe

__all__ = ["app", "run"]

app = typer.Typer(
    help="Four-light photometric stereo: capture a surface, find its texture and its angle.",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command()(demo.demo)
app.command()(sets.capture)
app.command("import")(sets.import_)
app.command()(sets.solve)
app.command()(textures.train)
app.command()(textures.classify)
app.command("evaluate")(textures.evaluate_)
app.command()(reproduce.reproduce)
app.command()(bench.bench)
app.add_typer(rig_app, name="rig")


def _version(asked: bool) -> None:
    if asked:
        print(f"ps4rig {version('ps4rig')}")
        raise typer.Exit


@app.callback(invoke_without_command=True)
def _options(
    context: typer.Context,
    _show_version: Annotated[
        bool,
        typer.Option("--version", callback=_version, is_eager=True, help="Show the version."),
    ] = False,
) -> None:
    """Four-light photometric stereo: capture a surface, find its texture and its angle."""
    if context.invoked_subcommand is None:
        print(context.get_help())


def run() -> int:
    """Run the command that the process was started with; returns its exit status.

    Raises
    ------
    KeyboardInterrupt
        If it was interrupted.
    """
    # What it says about damaged files is said once, by the error line.
    logging.getLogger("tifffile").setLevel(logging.CRITICAL)
    try:
        status = app(standalone_mode=False)
        if sys.stdout is not None:
            sys.stdout.flush()
    except OSError as error:
        print(f"ps4rig: {describe(error)}", file=sys.stderr)
        # Nothing is left to be written at the end of the process, where it would fail again.
        os._exit(InputError.exit_status)
    except typer.Abort:
        status = INTERRUPTED_STATUS
    except Exception as error:
        # The usage errors of typer have no class of their own in its public face.
        message = getattr(error, "format_message", None)
        if message is None:
            raise
        print(f"ps4rig: {' '.join(message().split())}; see --help", file=sys.stderr)
        return InputError.exit_status
    if status == INTERRUPTED_STATUS:  # typer made a status of the exception
        raise KeyboardInterrupt
    return status if isinstance(status, int) else 0
