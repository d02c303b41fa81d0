"""Log files to which lines are appended."""

from pathlib import Path

from classify.errors import InputError


def append_line(path: Path, line: str) -> None:
    """Append a line to a log, which is made if it is missing.

    Raises
    ------
    InputError
        If it cannot be written, or is a pipe or a device, which may block.
    """
    try:
        if path.exists() and not path.is_file():
            raise InputError(f"{path}: cannot be written: it is not a regular file")
        with path.open("a", encoding="utf-8") as file:
            file.write(f"{line}\n")
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from error
