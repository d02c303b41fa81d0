"""Check an output file before a command starts its work; lines of CSV and of logs."""

import csv
import io
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from classify.base.durable_file import require_folder
from classify.base.errors import InputError

_FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r", "\n")


def escaped(text: str) -> str:
    """Escape the line breaks and other control characters of a text."""
    return "".join(
        character if character.isprintable() else character.encode("unicode_escape").decode()
        for character in text
    )


def check_output(
    path: Path, *, suffix: str, inputs: Iterable[Path] = (), force: bool = False
) -> None:
    """Check that a command may write to `path`.

    It must end in `suffix`, and be none of `inputs`. With `force` it may exist.
    """
    if not path.name.endswith(suffix):
        raise InputError(f"{path}: the name of the output must end in {suffix}")
    target = Path(os.path.realpath(path))
    if not target.name.endswith(suffix):
        raise InputError(
            f"{path}: leads to {target}, whose name does not end in {suffix}; choose another"
        )
    require_folder(path)
    if not path.exists():
        return
    if not path.is_file():
        raise InputError(f"{path}: exists and is not a regular file; choose another name")
    if is_input(path, inputs):
        raise InputError(f"{path}: is an input of this command; choose another output")
    if not force:
        raise InputError(f"{path}: exists already; choose another name or give --force")


def is_input(path: Path, inputs: Iterable[Path]) -> bool:
    """Whether a file exists and is one of `inputs`, under any name."""
    return path.exists() and any(file.exists() and file.samefile(path) for file in inputs)


def csv_line(cells: Iterable[Any]) -> str:
    """Return a line of CSV (RFC 4180).

    Cells that a spreadsheet would read as a formula get an apostrophe (OWASP, "CSV Injection").
    """
    line = io.StringIO()
    csv.writer(line).writerow(map(_escape_formula, cells))
    return line.getvalue()


def _escape_formula(cell: Any) -> Any:
    if not isinstance(cell, str) or not cell.startswith(_FORMULA_STARTS):
        return cell
    try:
        float(cell)
    except ValueError:
        return f"'{cell}"
    return cell


def append_line(path: Path, line: str) -> None:
    """Append a line to a log, which is made if it is missing."""
    try:
        with open(path, "a", encoding="utf-8", opener=_open_without_waiting) as file:
            file.write(f"{line}\n")
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from error


def _open_without_waiting(path: str, flags: int) -> int:
    """Open a file; opening a pipe without a reader fails, instead of waiting for one."""
    descriptor = os.open(path, flags | getattr(os, "O_NONBLOCK", 0), 0o666)
    if hasattr(os, "O_NONBLOCK"):  # not on Windows
        os.set_blocking(descriptor, True)
    return descriptor
