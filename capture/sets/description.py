"""The description of a captured set, such as its label, and its corrections."""

import math
from collections.abc import Mapping
from dataclasses import replace
from datetime import datetime
from typing import Literal, get_args

from capture.process.utc_time import utc_text
from classify.errors import InputError
from classify.labels import checked_label

from .captured_set import CapturedSet
from .metadata import CorrectionRecord, SetMetadata

Field = Literal["label", "specimen", "operator", "note", "orientation_deg"]
FIELDS: tuple[Field, ...] = get_args(Field)
# A page of text; a longer story belongs into a file of its own.
_MAX_CHARACTERS = 4000


def described(
    captured: CapturedSet,
    *,
    specimen: str | None,
    operator: str | None,
    note: str | None,
    orientation_deg: float | None = None,
) -> CapturedSet:
    """Return a set with its description; None leaves a text empty and the orientation unchanged."""
    texts = {"specimen": specimen, "operator": operator, "note": note}
    for name, text in texts.items():
        if text is not None:
            checked_text(name, text)
    orientation = {} if orientation_deg is None else {"orientation_deg": orientation_deg}
    return replace(captured, metadata=captured.metadata.model_copy(update=texts | orientation))


def corrected(
    metadata: SetMetadata, values: Mapping[str, str], corrected_utc: datetime
) -> SetMetadata:
    """Return metadata with other values of some of `FIELDS`; dated entries keep the old ones."""
    date = utc_text(corrected_utc)
    changes = {name: _value(name, text) for name, text in values.items()}
    entries = tuple(
        CorrectionRecord.model_validate(
            {"corrected_utc": date, "field": name, "before": before, "after": after}
        )
        for name, after in changes.items()
        if (before := getattr(metadata, name)) != after
    )
    return metadata.model_copy(update={**changes, "corrections": metadata.corrections + entries})


def as_captured(metadata: SetMetadata, field: str) -> str | float | None:
    """Return the value of a field before all corrections."""
    before = (each.before for each in metadata.corrections if each.field == field)
    value: str | float | None = next(before, getattr(metadata, field))
    return value


def _value(name: str, text: str) -> str | float | None:
    if name not in FIELDS:
        raise InputError(f"{name}: cannot be corrected; the fields are {', '.join(FIELDS)}")
    if not text:
        return None
    if name == "orientation_deg":
        try:
            degrees = float(text)
        except ValueError:
            degrees = math.nan
        if not math.isfinite(degrees):
            raise InputError(f"orientation_deg {text}: give degrees, such as 40")
        return degrees
    return checked_label(text) if name == "label" else checked_text(name, text)


def checked_text(name: str, text: str) -> str:
    """Return `text` if it can stand in the metadata of a set under `name`."""
    if not text.isprintable():
        raise InputError(f"{name} {text!r}: use printable characters only")
    if len(text) > _MAX_CHARACTERS:
        raise InputError(
            f"{name}: {len(text)} characters; up to {_MAX_CHARACTERS} are kept in a set"
        )
    return text
