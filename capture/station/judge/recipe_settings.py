"""Change settings of a recipe, which ends its approval; list the settings that differ."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from pydantic import ValidationError

from capture.station.domain.errors import RecipeError
from capture.station.domain.recipe import Recipe
from capture.station.domain.recipe_file import RecipeFolder, read_recipe, write_recipe
from classify.base.models import messages_by_place

from .approval import RecordChange, require_unchanged

_SETTINGS = (
    "note", "pass", "fail", "orientation", "limits", "limits_of", "region", "light", "calibration",
    "acknowledged",
)  # fmt: skip
"""Keys of a recipe that people set; teaching and approval write all others."""

Place = tuple[str | int, ...]
"""Path of a field, such as ``("limits", "margin")``."""


class SettingsRefused(RecipeError):  # noqa: N818 - caused by the input, not by the program
    """Invalid settings of a recipe; `messages` are by the `Place` of the field."""

    def __init__(self, messages: Mapping[Place, str]) -> None:
        self.messages = dict(messages)
        lines = (f"{dotted(place)}: {message}" for place, message in self.messages.items())
        super().__init__("; ".join(lines))


@dataclass(frozen=True)
class _SettingChange:
    """A setting that differs between two states, with both values as text; None if not set."""

    key: str
    before: str | None
    after: str | None

    def __str__(self) -> str:
        return f"{self.key}: {self.before or 'nothing'} -> {self.after or 'nothing'}"


def dotted(place: Place) -> str:
    """Return the dotted name of a field, such as ``limits.margin``; ``recipe`` for the whole."""
    return ".".join(map(str, place)) or "recipe"


def with_settings(recipe: Recipe, values: Mapping[str, Any]) -> Recipe:
    """Return a recipe with new values for the given keys, without approval."""
    unknown = [key for key in values if key not in _SETTINGS]
    if unknown:
        message = f"is not a setting; settings are {', '.join(_SETTINGS)}"
        raise SettingsRefused({(key[:100],): message for key in unknown})
    before = recipe.model_dump(by_alias=True, exclude={"approval"})
    try:
        return Recipe.model_validate(before | dict(values))
    except ValidationError as error:
        raise SettingsRefused(messages_by_place(error)) from error


def setting_changes(before: Recipe, after: Recipe) -> list[_SettingChange]:
    """Return the settings that differ between two states of a recipe."""
    old, new = (dict(_flat_settings(recipe)) for recipe in (before, after))
    keys = dict.fromkeys([*old, *new])
    return [
        _SettingChange(key, old.get(key), new.get(key))
        for key in keys
        if old.get(key) != new.get(key)
    ]


def save_settings(
    files: RecipeFolder,
    values: Mapping[str, Any],
    shown_sha256: str,
    record: RecordChange = lambda *_: None,
) -> None:
    """Give a recipe new values for the given keys, unless its hash is no longer `shown_sha256`."""
    with files.changing():
        before = read_recipe(files.file)
        require_unchanged(before, shown_sha256)
        after = with_settings(before, values)
        if setting_changes(before, after):
            record(before, after)
            write_recipe(files.file, after)


def _flat_settings(recipe: Recipe) -> Iterator[tuple[str, str]]:
    """Yield dotted names and values as text of all settings."""
    values = recipe.model_dump(mode="json", by_alias=True, exclude_none=True)
    for key in _SETTINGS:
        yield from _flat(key, values.get(key))


def _flat(key: str, value: Any) -> Iterator[tuple[str, str]]:
    if isinstance(value, dict):
        for name, item in value.items():
            yield from _flat(f"{key}.{name}", item)
    elif isinstance(value, list):
        yield key, ", ".join(map(str, value))
    elif value is not None:
        yield key, str(value)
