"""The command ``ps4rig``."""

from __future__ import annotations

import logging
from importlib.metadata import version
from typing import Annotated

import typer

from . import set_commands, texture_commands
from .demo import demo

__all__ = ["app", "main"]

app = typer.Typer(
    help="Four-light photometric stereo: capture a surface, find its texture and its angle.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command()(demo)
app.command()(set_commands.capture)
app.command("import")(set_commands.import_)
app.command()(set_commands.solve)
app.command()(texture_commands.train)
app.command()(texture_commands.classify)
app.command("evaluate")(texture_commands.evaluate_)


def _version(asked: bool) -> None:
    if asked:
        print(f"ps4rig {version('ps4rig')}")
        raise typer.Exit


@app.callback()
def _options(
    show_version: Annotated[
        bool,
        typer.Option("--version", callback=_version, is_eager=True, help="Show the version."),
    ] = False,
) -> None:
    """Four-light photometric stereo: capture a surface, find its texture and its angle."""


def main() -> None:
    """Entry point of the console command."""
    # What it says about damaged files is said once, by the error line.
    logging.getLogger("tifffile").setLevel(logging.CRITICAL)
    app()
