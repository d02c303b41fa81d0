"""Output of commands: results on stdout, progress and one line for an error on stderr."""

from __future__ import annotations

import functools
import json
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, ParamSpec, Protocol, TypeVar

import typer
from rich.console import Console

from classify.base.errors import InputError, Ps4rigError

from .interrupts import INTERRUPTED_STATUS, interruptible

if TYPE_CHECKING:
    from rich.table import Table

# Number of characters of a line on which no table is wrapped.
_UNLIMITED_WIDTH = 100_000
_LINE_WIDTH, _MIN_PROSE_WIDTH = 80, 40

_P = ParamSpec("_P")
_R = TypeVar("_R")
_T = TypeVar("_T")

# No markup, because a file may be called [oak].ome.tif; no wrapping, because lines go into logs.
out = Console(highlight=False, markup=False, emoji=False, soft_wrap=True)


def print_json(value: Any) -> None:
    """Print `value` as JSON on stdout, for another program."""
    print(json.dumps(value, indent=1, allow_nan=False))


class ShowProgress(Protocol):
    """Yields items and shows the number of finished ones, as `progress` does."""

    def __call__(self, items: Iterable[_T], total: int, description: str, /) -> Iterator[_T]:
        """Yield `items`."""


@contextmanager
def progress_bar(total: int, description: str) -> Iterator[Callable[[float], None]]:
    """Show a progress bar on a terminal; yield the function that sets the number of done items."""
    console = Console(stderr=True)
    if not console.is_terminal:
        yield lambda _: None
        return
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn

    columns = ("{task.description}", BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task(description, total=total)
        yield lambda done: bar.update(task, completed=done)


def progress(items: Iterable[_T], total: int, description: str) -> Iterator[_T]:
    """Yield `items` and show a progress bar on a terminal."""
    with progress_bar(total, description) as show:
        for done, item in enumerate(items, start=1):
            yield item
            show(done)


def complain(message: str) -> None:
    """Print an error, a warning or an address as one line on stderr."""
    print(f"ps4rig: {' '.join(message.split())}", file=sys.stderr)


def add_commands(group: typer.Typer, commands: Mapping[str, Callable[..., None]]) -> None:
    """Add commands, which report expected errors as one line on stderr and an exit status."""
    for name, command in commands.items():
        group.command(name)(_reporting_errors(command))


def _reporting_errors(command: Callable[_P, _R]) -> Callable[_P, _R]:
    @functools.wraps(command)
    def run(*arguments: _P.args, **options: _P.kwargs) -> _R:
        try:
            with interruptible():
                return command(*arguments, **options)
        except Ps4rigError as error:
            message, status = str(error), error.exit_status
        except MemoryError:
            message = "not enough memory; use a smaller frame or fewer sets"
            status = InputError.exit_status
        except OSError as error:
            cause = error.strerror or str(error)
            message = f"{error.filename}: {cause}" if error.filename else cause
            status = InputError.exit_status
        except KeyboardInterrupt:  # `__main__` prints its line
            raise typer.Exit(INTERRUPTED_STATUS) from None
        complain(message)
        raise typer.Exit(status)

    return run


def new_table(*columns: str, prose: str | None = None) -> Table:
    """Make a table for `print_table`. Only the column `prose` is wrapped, between words."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    table = Table(box=SIMPLE_HEAD, collapse_padding=True, pad_edge=False)
    for column in columns:
        table.add_column(column, no_wrap=column != prose)
    return table


def print_table(table: Table) -> None:
    """Print a table whose column of prose is wrapped to fit `_LINE_WIDTH` characters.

    The width of the terminal has no influence, so that logs and pipes get the same text.
    """
    from rich.cells import cell_len
    from rich.measure import Measurement

    def width() -> int:
        return Measurement.get(out, out.options.update(width=_UNLIMITED_WIDTH), table).maximum

    if table.title:
        out.print(table.title)
        table.title = None
    min_widths = []
    for column in table.columns:
        text = "\n".join(map(str, (column.header, *column.cells)))
        column.width = max(map(cell_len, text.split("\n")))
        min_widths.append(max(_MIN_PROSE_WIDTH, *map(cell_len, text.split())))
    excess = max(width() - _LINE_WIDTH, 0)
    for column, min_width in zip(table.columns, min_widths, strict=True):
        if column.width is not None and not column.no_wrap:
            column.width = min(column.width, max(column.width - excess, min_width))
    console = Console(width=width(), highlight=False, markup=False, emoji=False)
    console.print(table, crop=False)


def add_group(
    parent: typer.Typer,
    group_name: str,
    help_text: str,
    commands: Mapping[str, Callable[..., None]],
    begin: Callable[[], None] = lambda: None,
) -> typer.Typer:
    """Add and return a group of `commands` by name; without one of them it prints its help.

    `begin` is called before every command.
    """
    group = typer.Typer()
    parent.add_typer(group, name=group_name)

    @group.callback(invoke_without_command=True, help=help_text)
    def options(context: typer.Context) -> None:
        begin()
        if context.invoked_subcommand is None:
            print(context.get_help())

    add_commands(group, commands)
    return group
