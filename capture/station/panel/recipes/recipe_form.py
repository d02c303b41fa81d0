"""Settings of a recipe as a form: its fields with values and messages, and the entered settings."""

import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from capture.base.names import typed_number
from capture.station.domain.limits import RANGES, ROWS, GeneralLimits, Limits
from capture.station.domain.recipe import (
    CalibrationRule,
    CameraSettings,
    Orientation,
    Recipe,
    Region,
)
from capture.station.domain.recipe_file import COMMENTS, SECTIONS
from capture.station.judge.recipe_settings import Place, dotted
from classify.base.models import Section

_MODELS: dict[str, type[Section]] = {
    "orientation": Orientation,
    "limits": GeneralLimits,
    "region": Region,
    "light": CameraSettings,
    "calibration": CalibrationRule,
}
_TEXTS = ("note", "acknowledged")
_YES_OR_NO = ("full_turn", "required")
_UNITS = {"_px": "px", "_deg": "degrees", "_ms": "ms", "_days": "days"}
_BOUNDS = ("least", "largest")


@dataclass(frozen=True)
class _FormField:
    """A field of the form."""

    name: str
    label: str
    hint: str
    kind: Literal["number", "yes", "text"]
    value: str
    message: str  # about an invalid value; empty for a valid one


@dataclass(frozen=True)
class _FormSection:
    """Fields with a heading; `message` is about an invalid combination of them."""

    title: str
    hint: str
    fields: tuple[_FormField, ...]
    message: str = ""

    @property
    def is_wrong(self) -> bool:
        """Whether the section has a message to show."""
        return bool(self.message or any(field.message for field in self.fields))


@dataclass(frozen=True)
class _TextureField:
    """A texture, and whether parts of it are good."""

    name: str
    texture: str
    is_good: bool


class RecipeForm:
    """The form of a recipe, with the values of the recipe or those that somebody entered."""

    def __init__(
        self,
        recipe: Recipe,
        entered: Mapping[str, str] | None = None,
        messages: Mapping[Place, str] | None = None,
    ) -> None:
        self._recipe = recipe
        self._entered = entered
        self._messages = dict(messages or {})
        self._shown_places: set[Place] = set()

    @property
    def is_wrong(self) -> bool:
        """Whether an entered value is wrong."""
        return bool(self._messages)

    def sections(self) -> list[_FormSection]:
        """Return all sections but the textures."""
        recipe = self._recipe
        sections = [
            self._section((name,), name, SECTIONS[name], model, getattr(recipe, name))
            for name, model in _MODELS.items()
        ]
        for number, texture in enumerate(recipe.passes):
            limits = recipe.limits_of.get(texture, Limits())
            hint = "Limits of this texture. An empty field takes the limit of all textures."
            place: Place = ("limits_of", texture)
            prefix = f"limits_of.{number}"
            title = f"limits of {texture}"
            sections.append(self._section(place, title, hint, Limits, limits, prefix))
        known = ", ".join(recipe.acknowledged)
        texts = (
            self._field(("note",), "note", recipe.note),
            self._field(("acknowledged",), "acknowledged", known),
        )
        return [_FormSection("note", "", texts), *sections]

    def textures(self) -> list[_TextureField]:
        """Return the textures, each good or bad."""
        return [
            _TextureField(_use_field(number), texture, self._is_good(number))
            for number, texture in enumerate(_textures(self._recipe))
        ]

    def other_messages(self) -> list[str]:
        """Return the messages that belong to no single field; call it after `sections`."""
        return [
            f"{dotted(place)}: {message}"
            for place, message in self._messages.items()
            if place not in self._shown_places
        ]

    def _section(
        self,
        place: Place,
        title: str,
        hint: str,
        model: type[Section],
        values: Section | None,
        prefix: str = "",  # of the names of fields, by default the dotted place
    ) -> _FormSection:
        fields = []
        for key in model.model_fields:
            value = None if values is None else getattr(values, key)
            name = f"{prefix or dotted(place)}.{key}"
            if key not in RANGES:
                fields.append(self._field((*place, key), name, value))
                continue
            for number, bound in enumerate(_BOUNDS):
                bound_value = None if value is None else value[number]
                field_name, label = f"{name}.{number}", f"{ROWS[key].label}, {bound}"
                fields.append(self._field((*place, key, number), field_name, bound_value, label))
        messages = [self._message((*place, key)) for key in RANGES if key in model.model_fields]
        messages.append(self._message(place))
        return _FormSection(title, hint, tuple(fields), "; ".join(filter(None, messages)))

    def _field(self, place: Place, name: str, value: Any, label: str = "") -> _FormField:
        key = str(place[-1] if not isinstance(place[-1], int) else place[-2])
        unit = next((unit for end, unit in _UNITS.items() if key.endswith(end)), "")
        text = label or key.replace("_", " ")
        for end in _UNITS:
            text = text.removesuffix(end.replace("_", " "))
        kind: Literal["number", "yes", "text"] = "number"
        if key in _YES_OR_NO:
            kind = "yes"
        elif key in _TEXTS:
            kind = "text"
        return _FormField(
            name=name,
            label=f"{text}, {unit}" if unit else text,
            hint=COMMENTS.get(key, ""),
            kind=kind,
            value=self._shown_text(name, value, is_truth=kind == "yes"),
            message=self._message(place, name),
        )

    def _shown_text(self, name: str, value: Any, *, is_truth: bool) -> str:
        if self._entered is not None:
            return self._entered.get(name, "")
        if is_truth:
            return "yes" if value else ""
        return _field_text(value)

    def _is_good(self, number: int) -> bool:
        if self._entered is not None:
            return self._entered.get(_use_field(number), "") == "pass"
        return number < len(self._recipe.passes)

    def _message(self, place: Place, name: str = "") -> str:
        self._shown_places.add(place)
        message, text = self._messages.get(place, ""), (self._entered or {}).get(name, "")
        is_with_comma = message and re.fullmatch(r"-?\d+,\d+", text.strip())
        return f"write {text.strip().replace(',', '.')}" if is_with_comma else message


def settings_of(recipe: Recipe, entered: Mapping[str, str]) -> dict[str, Any]:
    """Return the settings of a form, not yet validated."""
    # Empty fields are left out. Textures that do not pass are bad.
    names = _textures(recipe)
    uses = [entered.get(_use_field(number), "") for number in range(len(names))]
    passes = [name for name, use in zip(names, uses, strict=True) if use == "pass"]
    settings: dict[str, Any] = {
        "note": entered.get("note", "").strip() or None,
        "acknowledged": [
            name for entry in entered.get("acknowledged", "").split(",") if (name := entry.strip())
        ],
        "pass": passes,
        "fail": [name for name in names if name not in passes],
        "limits_of": {},
    }
    for name, model in _MODELS.items():
        settings[name] = dict(_entered_settings(model, name, entered, getattr(recipe, name)))
    if not settings["region"]:
        settings["region"] = None
    for number, texture in enumerate(recipe.passes):
        present = recipe.limits_of.get(texture)
        limits = dict(_entered_settings(Limits, f"limits_of.{number}", entered, present))
        if limits and texture in passes:
            settings["limits_of"][texture] = limits
    return settings


def _textures(recipe: Recipe) -> tuple[str, ...]:
    return (*recipe.passes, *recipe.fails)


def _use_field(number: int) -> str:
    return f"use.{number}"


def _entered_settings(
    model: type[Section], prefix: str, entered: Mapping[str, str], present: Section | None
) -> Iterator[tuple[str, Any]]:
    for key in model.model_fields:
        name, value = f"{prefix}.{key}", getattr(present, key, None)
        if key in _YES_OR_NO:
            yield key, entered.get(name) == "yes"
        elif key in RANGES:
            values = value or (None, None)
            bounds = [
                _number(entered.get(f"{name}.{number}", ""), values[number])
                for number in range(len(_BOUNDS))
            ]
            if any(bound is not None for bound in bounds):
                yield key, bounds
        elif (number := _number(entered.get(name, ""), value)) is not None:
            yield key, number


def _field_text(value: Any) -> str:
    """Return a value of the recipe as its field shows it: a number with four digits."""
    if isinstance(value, float):
        return np.format_float_positional(value, precision=4, fractional=False, trim="-")
    return "" if value is None else str(value)


def _number(entered: str, present: float | None) -> int | float | str | None:
    """Return the number in a field; None if it is empty, or a text that is no number."""
    # A field shows four digits of the present value. If unchanged, it returns all digits.
    text = entered.strip()
    if text == _field_text(present):
        return present
    with suppress(ValueError):
        number = typed_number(text)
        return int(text) if text.lstrip("+-").isdecimal() else number
    return text or None
