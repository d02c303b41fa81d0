"""The parts of a calibration as plain values and arrays, and back."""

from dataclasses import fields, is_dataclass
from typing import Any, Final, Literal, get_args, get_origin, get_type_hints

import numpy as np
from pydantic import TypeAdapter

from classify import Lighting
from classify.base.arrays import Array
from classify.base.errors import InputError
from classify.calibration.calibration import Calibration

_Values = dict[str, Any]

# A dark part of 16 exposures has 15.
_MOST_LEVELS = 20

PartName = Literal["dark", "response", "noise", "flat_field", "lights", "scale"]
PART_NAMES: Final[tuple[PartName, ...]] = get_args(PartName)


def flattened(part: Any) -> tuple[_Values, dict[str, Array]]:
    """The plain values and the arrays of a part, each by the path of its field."""
    values: _Values = {}
    arrays: dict[str, Array] = {}

    def take(owner: Any, path: str) -> None:
        for field in fields(owner):
            value, name = getattr(owner, field.name), path + field.name
            # Intensities that were not given are all 1, and are not stored.
            absent = isinstance(owner, Lighting) and field.name == "intensities"
            if not field.init or (absent and not owner.intensities_given):
                continue
            if isinstance(value, np.ndarray):
                arrays[name] = value
            elif is_dataclass(value):
                take(value, name + ".")
            else:
                values[name] = list(value) if isinstance(value, tuple) else value

    take(part, "")
    return values, arrays


def rebuilt(name: PartName, values: _Values, arrays: dict[str, Array]) -> Any:
    """Return the part of `flattened`."""
    left = {*values, *arrays}
    if max((field_path.count(".") for field_path in left), default=0) > _MOST_LEVELS:
        raise InputError(f"fields are nested more than {_MOST_LEVELS} times")

    def put(kind: Any, path: str) -> Any:
        arguments: dict[str, Any] = {}
        hints = get_type_hints(kind)
        for field in fields(kind):
            hint, field_path = hints[field.name], path + field.name
            if not field.init:
                continue
            if field_path in arrays:
                arguments[field.name] = _checked_array(arrays[field_path], hint, field_path)
            elif field_path in values:
                arguments[field.name] = _checked_value(values[field_path], hint, field_path)
            elif any(remaining.startswith(field_path + ".") for remaining in left):
                arguments[field.name] = put(
                    _part_of(hint, is_dataclass, field_path), field_path + "."
                )
            left.discard(field_path)
        try:
            return kind(**arguments)
        except TypeError as error:  # a field without default is missing
            raise InputError(f"{path or name}: {error}") from error

    part = put(_part_of(get_type_hints(Calibration)[name], is_dataclass, name), "")
    if left:
        raise InputError(f"field {min(left)!r} is unknown")
    return part


def _part_of(hint: Any, is_wanted: Any, path: str) -> Any:
    """The first of the alternatives of `hint` for which `wanted` is true."""
    for alternative in (hint, *get_args(hint)):
        if is_wanted(alternative):
            return alternative
    raise InputError(f"field {path} is of another kind")


def _is_array(hint: Any) -> bool:
    origin: Any = get_origin(hint)
    return origin is np.ndarray


def _checked_array(array: Array, hint: Any, path: str) -> Array:
    kind = _part_of(hint, _is_array, path)
    dtype = get_args(get_args(kind)[1])[0]
    if array.dtype != np.dtype(dtype) or (array.dtype.kind == "f" and not np.isfinite(array).all()):
        raise InputError(f"field {path} is {array.dtype}, or contains NaN; wanted is {dtype}")
    return array


def _checked_value(value: Any, hint: Any, path: str) -> Any:
    arrays_or_parts = any(
        is_dataclass(alternative) or _is_array(alternative)
        for alternative in (hint, *get_args(hint))
    )
    if value is None and type(None) in get_args(hint):
        return None
    if arrays_or_parts:
        raise InputError(f"field {path} is of another kind")
    adapter: TypeAdapter[Any] = TypeAdapter(hint, config={"allow_inf_nan": False})
    try:
        return adapter.validate_python(tuple(value) if isinstance(value, list) else value)
    except ValueError as error:
        raise InputError(f"field {path} is {value!r}") from error
