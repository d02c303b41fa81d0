"""The description of a captured set, such as its label, and its corrections."""

import math
import re
import tomllib
from collections.abc import Mapping
from dataclasses import replace
from datetime import date, datetime, time
from types import MappingProxyType
from typing import Any, Literal, get_args

from capture.base.names import checked_text, typed_number
from capture.base.utc_time import utc_text
from classify.base.errors import InputError
from classify.methods import checked_label

from .captured_set import CapturedSet
from .metadata import CorrectionRecord, Property, SetMetadata

_Field = Literal["label", "specimen", "operator", "note", "orientation_deg"]
FIELDS: tuple[_Field, ...] = get_args(_Field)
_PROPERTY_PREFIX = "properties."
_MAX_PROPERTIES = 50


def described(
    captured: CapturedSet,
    *,
    specimen: str | None,
    operator: str | None,
    note: str | None,
    orientation_deg: float | None = None,
    properties: Mapping[str, Property] = MappingProxyType({}),
) -> CapturedSet:
    """Return a set with its description; None leaves a text empty and the orientation unchanged."""
    fields: dict[str, Any] = {
        "specimen": specimen, "operator": operator, "note": note,
        "properties": checked_properties(properties),
    }  # fmt: skip
    for name, text in fields.items():
        if isinstance(text, str):
            checked_text(name, text)
    orientation = {} if orientation_deg is None else {"orientation_deg": orientation_deg}
    return replace(captured, metadata=captured.metadata.model_copy(update=fields | orientation))


def corrected(
    metadata: SetMetadata, values: Mapping[str, str], corrected_utc: datetime
) -> SetMetadata:
    """Return metadata with other values of some of `FIELDS`; `corrections` has the old ones."""
    date_text = utc_text(corrected_utc)
    changes = {
        name: _parsed_value(name, text, _value_of(metadata, name)) for name, text in values.items()
    }
    entries = tuple(
        CorrectionRecord.model_validate(
            {"corrected_utc": date_text, "field": name, "before": before, "after": after}
        )
        for name, after in changes.items()
        if (before := _value_of(metadata, name)) != after or type(before) is not type(after)
    )
    fields: dict[str, Any] = {name: changes[name] for name in FIELDS if name in changes}
    changed_properties = {
        name.removeprefix(_PROPERTY_PREFIX): value
        for name, value in changes.items()
        if name not in fields
    }
    properties = {**metadata.properties, **changed_properties}
    fields["properties"] = checked_properties(
        {name: value for name, value in properties.items() if value is not None}
    )
    corrections = metadata.corrections + entries
    return metadata.model_copy(update={**fields, "corrections": corrections})


def _value_of(metadata: SetMetadata, field: str) -> Property | None:
    """Return the present value of a field of `FIELDS`, or of ``properties.NAME``."""
    if field.startswith(_PROPERTY_PREFIX):
        return metadata.properties.get(field.removeprefix(_PROPERTY_PREFIX))
    if field not in FIELDS:
        fields = ", ".join([*FIELDS, f"{_PROPERTY_PREFIX}NAME"])
        raise InputError(f"{field}: cannot be corrected; the fields are {fields}")
    value: Property | None = getattr(metadata, field)
    return value


def as_captured(metadata: SetMetadata, field: str) -> Property | None:
    """Return the value of a field before all corrections."""
    corrections = (correction for correction in metadata.corrections if correction.field == field)
    first = next(corrections, None)
    return _value_of(metadata, field) if first is None else first.before


def exact_value(value: Property | None) -> str | int | None:
    """Return a value for a table: floats exactly, but without ``.0``; ``true`` and ``false``."""
    if isinstance(value, bool):
        return str(value).lower()
    return repr(value).removesuffix(".0") if isinstance(value, float) else value


def checked_properties(values: Mapping[str, object]) -> dict[str, Property]:
    """Return properties of a specimen that can stand in the metadata of a set, dates as text."""
    if len(values) > _MAX_PROPERTIES:
        raise InputError(f"{len(values)} properties; up to {_MAX_PROPERTIES} are kept in a set")
    return {_property_name(name): _property(name, value) for name, value in values.items()}


def _property_name(name: str) -> str:
    if not re.fullmatch(r"\w[\w .%/()-]{0,59}", name):
        raise InputError(
            f"property {name!r}: use up to 60 letters, digits, blanks and _ . % / ( ) -, and begin "
            "with a letter or digit"
        )
    return name


def _property(name: str, value: object) -> Property:
    if isinstance(value, date | time):
        value = value.isoformat()
    if isinstance(value, str):
        return checked_text(name, value)
    if isinstance(value, bool | int) and abs(value) < 2**63:
        return value
    if isinstance(value, float) and math.isfinite(value):
        return value
    raise InputError(
        f"property {name}: {value!r} is not a text, a finite number of up to 64 bits, true, false "
        "or a date"
    )


def _parsed_value(name: str, text: str, before: Property | None) -> Property | None:
    if not text:
        return None
    if name.startswith(_PROPERTY_PREFIX):
        return text if isinstance(before, str) else _property(name, _toml_value(text))
    if name == "orientation_deg":
        try:
            degrees = typed_number(text)
        except ValueError:
            degrees = math.nan
        if not math.isfinite(degrees):
            raise InputError(f"orientation_deg {text}: give degrees, such as 40")
        return degrees
    return checked_label(text) if name == "label" else checked_text(name, text)


def _toml_value(text: str) -> object:
    """Read a number, a truth value or a date as a plan does; anything else is a text."""
    toml_text = text.lower() if text.lower() in ("true", "false") else text
    try:
        value: object = tomllib.loads(f"value = {toml_text}")["value"]
    except ValueError:
        return text
    return value if isinstance(value, bool | int | float | date | time) else text
