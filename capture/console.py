"""How commands speak: results on stdout, progress and errors on stderr, one line an error."""

from __future__ import annotations

import functools
import json
import os
import signal
import sys
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn, ParamSpec, TypeVar

import typer
from rich.console import Console

from classify.errors import InputError, Ps4rigError

if TYPE_CHECKING:
    from rich.table import Table

__all__ = [
    "INTERRUPTED_STATUS",
    "JsonOption",
    "SchedulerOption",
    "SetsArgument",
    "WorkersOption",
    "describe",
    "folding_table",
    "out",
    "print_json",
    "progress",
    "reported",
]

INTERRUPTED_STATUS = 130
MAX_WORKERS = 1024
MANY_SETS = "With many sets"
JsonOption = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]
SetsArgument = Annotated[
    list[Path],
    typer.Argument(metavar="SET...", help="Captured sets, and folders with captured sets."),
]
WorkersOption = Annotated[
    int | None,
    typer.Option(
        min=1,
        max=MAX_WORKERS,
        help="Processes on this machine.",
        show_default="one per core",
        metavar="N",
        rich_help_panel=MANY_SETS,
    ),
]
SchedulerOption = Annotated[
    str | None,
    typer.Option(
        help="Scheduler of a Dask cluster that sees the same files, as tcp://HOST:8786. "
        "Whoever runs it can run code here: give only one that you trust.",
        metavar="ADDRESS",
        rich_help_panel=MANY_SETS,
    ),
]

P = ParamSpec("P")
R = TypeVar("R")
T = TypeVar("T")

# Plain: a file called [oak].ome.tif is no markup.
out = Console(highlight=False, markup=False, emoji=False)


def print_json(value: Any) -> None:
    """`value` as JSON on stdout, for another program."""
    print(json.dumps(value, indent=1, allow_nan=False))


def progress(items: Iterable[T], total: int, what: str) -> Iterator[T]:
    """Pass on `items` with a bar on stderr, on a terminal only."""
    console = Console(stderr=True)
    if not console.is_terminal:
        yield from items
        return
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, transient=True) as bar:
        yield from bar.track(items, total=total, description=what)


def reported(command: Callable[P, R]) -> Callable[P, R]:
    """Turn what a command raises into one line on stderr and an exit status.

    Of an interrupt there is only the status: its line is that of the whole program.
    """

    @functools.wraps(command)
    def run(*arguments: P.args, **options: P.kwargs) -> R:
        for ending in (signal.SIGTERM, signal.SIGHUP):
            signal.signal(ending, _terminate)
        try:
            result = command(*arguments, **options)
            # Here and not at the end of the process, where a full disk could no longer be reported.
            if sys.stdout is not None:  # closed by whoever started us
                sys.stdout.flush()
            return result
        except Ps4rigError as error:
            print(f"ps4rig: {' '.join(str(error).split())}", file=sys.stderr)
            raise typer.Exit(error.exit_status) from None
        except MemoryError:
            print("ps4rig: not enough memory; use a smaller frame or fewer sets", file=sys.stderr)
            raise typer.Exit(InputError.exit_status) from None
        except BrokenPipeError:
            # Whoever read our output has gone, and with it whoever could be told.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            raise typer.Exit(InputError.exit_status) from None
        except OSError as error:
            print(f"ps4rig: {describe(error)}", file=sys.stderr)
            raise typer.Exit(InputError.exit_status) from None
        except KeyboardInterrupt:
            raise typer.Exit(INTERRUPTED_STATUS) from None

    return run


def folding_table(*columns: str) -> Table:
    """A table that breaks what is too long for the terminal instead of cutting it off."""
    from rich.table import Table

    table = Table()
    for column in columns:
        table.add_column(column, overflow="fold")
    return table


def describe(error: OSError) -> str:
    """The file and the cause, as far as the error knows them."""
    cause = error.strerror or str(error)
    return f"{error.filename}: {cause}" if error.filename else cause


def _terminate(*_: object) -> NoReturn:
    # As an exception, so that LEDs go out and temporary files go away on the way up.
    raise KeyboardInterrupt
