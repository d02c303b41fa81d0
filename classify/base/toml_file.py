"""Read TOML files as validated values; a fault of a file is an error in one line."""

import tomllib
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from classify.base.errors import ConfigError, InputError
from classify.base.regular_file import read_regular_file

from .validation_message import validation_message

MAX_TOML_BYTES = 1 << 20  # a complete rig.toml has about 3 kB, a plan of 10 000 specimens 700 kB

Model = TypeVar("Model", bound=BaseModel)


def read_toml(path: Path, if_missing: str) -> dict[str, Any]:
    """Read the values of a TOML file; `if_missing` ends the message about a missing one."""
    try:
        return tomllib.loads(read_regular_file(path, MAX_TOML_BYTES).decode())
    except InputError as error:
        missing = isinstance(error.__cause__, FileNotFoundError)
        raise ConfigError(f"{path}: {if_missing}" if missing else str(error)) from error
    # tomllib also raises the errors of deep nesting and of very long numbers.
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"{path}: not valid TOML: {error}") from error


def validated(values: dict[str, Any], model: type[Model], source: str) -> Model:
    """Return `values` as a `model`; a `ConfigError` names `source`, key and value."""
    try:
        return model.model_validate(values)
    except ValidationError as error:
        raise ConfigError(f"{source}: {validation_message(error, model)}") from error


def read_toml_as(path: Path, model: type[Model], if_missing: str) -> Model:
    """Read a TOML file as a `model`; see `read_toml` and `validated`."""
    return validated(read_toml(path, if_missing), model, str(path))
