"""Files with secrets: JSON that only their owner may read, written whole or not at all."""

import json
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel

from classify.durable_file import durable_file
from classify.errors import InputError
from classify.regular_file import read_regular_file
from rig.config.toml_file import validated

# A thousand users or clients have 200 kB.
_MAX_BYTES = 1 << 20
_OWNER_ONLY = 0o600

Model = TypeVar("Model", bound=BaseModel)


def read_private(path: Path, model: type[Model]) -> Model:
    """Read a file as a `model`; a missing one is an empty object.

    Raises
    ------
    InputError
        If it cannot be read, or is damaged.
    """
    try:
        values: Any = json.loads(read_regular_file(path, _MAX_BYTES))
    except InputError as error:
        if not isinstance(error.__cause__, FileNotFoundError):
            raise
        values = {}
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: damaged: {error}; restore it from a backup") from error
    return validated(values, model, str(path))


def write_private(path: Path, model: BaseModel) -> None:
    """Replace a file; only its owner may read it.

    Raises
    ------
    InputError
        If it cannot be written.
    """
    with durable_file(path) as temporary:
        temporary.chmod(_OWNER_ONLY)  # before there is anything in it
        temporary.write_text(model.model_dump_json(indent=1) + "\n", encoding="utf-8")


def change_stamp(path: Path) -> tuple[int, int, int] | None:
    """Return what changes whenever `write_private` replaces a file; None for a missing one."""
    try:
        about = path.stat()
    except OSError:
        return None
    return about.st_ino, about.st_mtime_ns, about.st_size
