"""The command ``ps4rig`` and its subcommands.

A command imports what it needs when it runs, so that ``--help`` answers at once.
"""

from __future__ import annotations

import logging
import shutil
import sys
from importlib.metadata import version
from typing import Annotated

import typer

from classify.errors import InputError, Ps4rigError

from .commands import bench, demo, reproduce, sets, textures
from .commands.rig import rig_app
from .console import complain
from .process.interrupts import INTERRUPTED_STATUS
from .process_settings import settle_process

__all__ = ["app", "run"]

app = typer.Typer(
    help="Four-light photometric stereo: capture a surface, find its texture and its orientation.",
    pretty_exceptions_enable=False,
    # The frames of a rich page of help leave no room for words on a narrow terminal.
    rich_markup_mode="rich" if shutil.get_terminal_size().columns >= 60 else None,
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


def _print_version(requested: bool) -> None:
    if requested:
        print(f"ps4rig {version('ps4rig')}")
        raise typer.Exit


@app.callback(invoke_without_command=True)
def _options(
    context: typer.Context,
    _show_version: Annotated[
        bool,
        typer.Option("--version", callback=_print_version, is_eager=True, help="Show the version."),
    ] = False,
) -> None:
    """Four-light photometric stereo: capture a surface, find its texture and its orientation."""
    if context.invoked_subcommand is None:
        print(context.get_help())


def run() -> int:
    """Run the command that the process was started with; return its exit status.

    Raises
    ------
    KeyboardInterrupt
        If a signal interrupted the command.
    """
    # Silences tifffile's log of damaged files, which the error line repeats.
    logging.getLogger("tifffile").setLevel(logging.CRITICAL)
    try:
        _check_arguments(sys.argv[1:])
        settle_process()
        status = app(standalone_mode=False)
    except Ps4rigError as error:
        complain(str(error))
        return error.exit_status
    except typer.Abort:
        status = INTERRUPTED_STATUS
    except Exception as error:
        # The public interface of typer has no class for its usage errors.
        message = getattr(error, "format_message", None)
        if message is None:
            raise
        complain(f"{message()}; see --help")
        return InputError.exit_status
    if status == INTERRUPTED_STATUS:  # typer turns the exception into a status
        raise KeyboardInterrupt
    return status if isinstance(status, int) else 0


def _check_arguments(arguments: list[str]) -> None:
    for argument in arguments:
        try:
            argument.encode()
        except UnicodeEncodeError as error:
            raise InputError(
                f"argument {argument}: not valid UTF-8; use another text, or rename the file"
            ) from error
