"""Models of the contents of files, reading TOML as a model, and errors in one line."""

import difflib
import json
import re
import tomllib
from pathlib import Path
from typing import Annotated, Any, Self, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator
from pydantic.fields import FieldInfo
from pydantic_core import PydanticCustomError

from classify.base.durable_file import durable_file
from classify.base.errors import ConfigError, InputError
from classify.base.regular_file import read_regular_file

Degrees = Annotated[float, Field(ge=-3600.0, le=3600.0)]


class Record(BaseModel):
    """A frozen object of a file that the program writes itself; it refuses unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    @classmethod
    def read(cls, path: Path, max_bytes: int, remedy: str) -> Self:
        """Read a file of JSON; `InputError`, with the remedy, if it is invalid."""
        try:
            return cls.model_validate_json(read_regular_file(path, max_bytes))
        except InputError as error:
            raise InputError(f"{error}; {remedy}") from error
        except ValidationError as error:
            raise InputError(f"{path}: {first_fault(error)}; {remedy}") from error

    def write(self, path: Path) -> None:
        """Replace a file of JSON, whole or not at all; InputError if it cannot be written."""
        with durable_file(path) as temporary:
            temporary.write_text(self.model_dump_json(indent=1), encoding="utf-8")


class Section(Record):
    """A frozen section that refuses unknown keys, and truth values and texts as numbers."""

    model_config = ConfigDict(strict=True)

    @field_validator("*")
    @classmethod
    def _contains_no_nul(cls, value: Any) -> Any:
        if isinstance(value, str) and "\0" in value:
            raise ValueError("contains a NUL character")
        return value


_MAX_TOML_BYTES = 1 << 20  # a complete rig.toml has about 3 kB, a plan of 10 000 specimens 700 kB

_MAX_TABLES = 20  # within each other; files of ps4rig have four
# A dotted key of more tables, which takes tomllib a time that is quadratic in their number.
_PART = r"(?<![^\s.,=#\[\]{}])[^\s.,=#\[\]{}]+"
_DEEP_NAME = re.compile(rf"(?:{_PART}[ \t]*\.[ \t]*){{{_MAX_TABLES}}}")
_TOO_DEEP = f"more than {_MAX_TABLES} tables within each other"
_Model = TypeVar("_Model", bound=BaseModel)


def read_toml(path: Path, if_missing: str) -> dict[str, Any]:
    """Read the values of a TOML file; `if_missing` ends the message about a missing one."""
    try:
        text = read_regular_file(path, _MAX_TOML_BYTES).decode()
        if _DEEP_NAME.search(text):
            raise ValueError(_TOO_DEEP)
        values = tomllib.loads(text)
        _require_shallow(values)
        return values
    except InputError as error:
        missing = isinstance(error.__cause__, FileNotFoundError)
        raise ConfigError(f"{path}: {if_missing}" if missing else str(error)) from error
    # tomllib also raises the errors of deep nesting and of very long numbers.
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"{path}: not valid TOML: {error}") from error


def _require_shallow(values: dict[str, Any]) -> None:
    """Raise ValueError for deep tables, which every later step would have to follow."""
    level: list[Any] = [values]
    for _ in range(_MAX_TABLES):
        inner = [value.values() if isinstance(value, dict) else value for value in level]
        level = [value for row in inner for value in row if isinstance(value, dict | list)]
        if not level:
            return
    raise ValueError(_TOO_DEEP)


def validated(values: dict[str, Any], model: type[_Model], source: str) -> _Model:
    """Return `values` as a `model`; a `ConfigError` names `source`, key and value."""
    try:
        return model.model_validate(values)
    except ValidationError as error:
        raise ConfigError(f"{source}: {validation_message(error, model)}") from error


def read_toml_as(path: Path, model: type[_Model], if_missing: str) -> _Model:
    """Read a TOML file as a `model`; see `read_toml` and `validated`."""
    return validated(read_toml(path, if_missing), model, str(path))


def explained(message: str) -> PydanticCustomError:
    """Return an error for a validator to raise, whose message already has key and value."""
    return PydanticCustomError("explained", "{message}", {"message": message})


def validation_message(error: ValidationError, root: type[BaseModel], section: str = "") -> str:
    """Describe the first error of `root`; an unknown key before others, which it may explain."""
    errors = error.errors(include_url=False)
    first = next((fault for fault in errors if fault["type"] == "extra_forbidden"), errors[0])
    location, value, cause = first["loc"], first["input"], first["msg"]
    field = ".".join(map(str, [*filter(None, [section]), *location]))
    match first["type"]:
        case "explained":
            return cause
        case "value_error":  # names key and value itself
            return ": ".join(filter(None, (field, cause.removeprefix("Value error, "))))
        case "missing":
            info = _fields_at(location[:-1], root).get(str(location[-1]))
            description = f": {info.description}" if info and info.description else ""
            return f"{field} is missing; give it{description}"
        case "extra_forbidden" | "unexpected_keyword_argument":
            return f"{field} = {toml_text(value)}: {_unknown_key(location, root)}"
        case "too_short" | "too_long":
            limits = first["ctx"]
            bound = (
                f"at least {limits['min_length']}"
                if first["type"] == "too_short"
                else f"at most {limits['max_length']}"
            )
            return f"{field} has {limits['actual_length']} values: must have {bound}"
        case "model_type" | "model_attributes_type" | "dict_type":
            return f"{field} = {toml_text(value)}: must be a table, [{field}]"
    return f"{field} = {toml_text(value)}: {in_words(cause)}"


def first_fault(error: ValidationError) -> str:
    """Return field and message of the first error in a file that this program wrote."""
    first = error.errors(include_url=False)[0]
    place = ".".join(map(str, first["loc"])) or "the file"
    return f"{place}: {first['msg']}"


def messages_by_place(error: ValidationError) -> dict[tuple[str | int, ...], str]:
    """Return the message for each wrong value, by its place, for a form that shows the value."""
    return {fault["loc"]: in_words(fault["msg"]) for fault in error.errors(include_url=False)}


def in_words(cause: str) -> str:
    """Rewrite a message of pydantic in the wording of this program."""
    cause = cause.removeprefix("Value error, ").replace("Field required", "is missing; give it")
    for old, new in (("Input should", "must"), ("should", "must"), ("valid integer", "integer")):
        cause = cause.replace(old, new)
    return cause.replace("a integer", "an integer").replace("a valid", "a")


def _unknown_key(location: tuple[str | int, ...], root: type[BaseModel]) -> str:
    fields = _fields_at(location[:-1], root)
    keys = [field.alias or name for name, field in fields.items()]
    near = difflib.get_close_matches(str(location[-1]), keys, 1)
    if near:
        return f"unknown key; did you mean {near[0]}?"
    return "unknown key; " + (f"the keys are {', '.join(keys)}" if keys else "leave it out")


def _fields_at(location: tuple[str | int, ...], root: type[BaseModel]) -> dict[str, FieldInfo]:
    """The fields of the model at a place of a file; empty if there is a plain value."""
    model: Any = root
    for part in location:
        model = getattr(getattr(model, "model_fields", {}).get(part), "annotation", None)
    return dict(getattr(model, "model_fields", {}))


def toml_text(value: object) -> str:
    """A value as in a TOML file, shortened."""
    text = json.dumps(value, default=str, ensure_ascii=False)
    return text if len(text) <= 60 else text[:57] + "..."
