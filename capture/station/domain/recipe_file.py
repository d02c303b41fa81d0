"""Read and write a recipe: TOML with a comment for every key."""

import json
from collections.abc import Iterator
from pathlib import Path

from capture.station.domain.errors import RecipeError
from classify.base.durable_file import durable_file
from classify.base.models import Section, read_toml_as

from .limits import Limits
from .recipe import Approval, CalibrationRule, Light, Orientation, Recipe, Region

SUFFIX = ".toml"

_MISSING = (
    "no such recipe; ps4rig station teach makes one; ps4rig station run --collect captures parts "
    "for it"
)
_HEAD = """\
# A recipe of the inspection station. A line that begins with # is a comment.
# After a change run ps4rig station challenge DIR, and
# ps4rig station approve DIR --recipe {name} --by WHO
"""
_MODELS: tuple[type[Section], ...] = (
    Approval, CalibrationRule, Light, Region, Limits, Orientation, Recipe,
)  # fmt: skip
COMMENTS = {
    field.alias or name: field.description or ""
    for model in _MODELS
    for name, field in model.model_fields.items()
}
"""What the keys of a recipe mean."""
_TABLES = ("orientation", "limits", "limits_of", "region", "light", "calibration", "approval")
SECTIONS = {name: f"{COMMENTS[name][0].upper()}{COMMENTS[name][1:]}." for name in _TABLES}
"""What the sections of a recipe mean."""


def read_recipe(path: Path) -> Recipe:
    """Read a recipe."""
    recipe = read_toml_as(path, Recipe, _MISSING)
    if path.name != recipe.name + SUFFIX:
        raise RecipeError(f"{path}: name = {recipe.name!r}: must be the name of the file")
    return recipe


def write_recipe(path: Path, recipe: Recipe) -> None:
    """Write a recipe, whole or not at all; an existing file is replaced."""
    with durable_file(path) as temporary:
        temporary.write_text(recipe_text(recipe), encoding="utf-8")


def recipe_text(recipe: Recipe) -> str:
    """Return the recipe as TOML; reading it gives an equal recipe."""
    return _HEAD.format(name=recipe.name) + "\n".join(_lines(recipe)) + "\n"


def _lines(recipe: Recipe) -> Iterator[str]:
    values = {
        field.alias or name: getattr(recipe, name) for name, field in Recipe.model_fields.items()
    }
    for key, value in values.items():
        if key not in SECTIONS:
            yield from _entry(key, value)
    for section, comment in SECTIONS.items():
        value = values[section]
        if section == "limits_of":
            tables = {f"{section}.{_toml(name)}": limits for name, limits in value.items()}
        else:
            tables = {} if value is None else {section: value}
        for number, (header, table) in enumerate(tables.items()):
            yield ""
            if number == 0:
                yield f"# {comment}"
            yield from _table(header, table)


def _table(header: str, table: Section) -> Iterator[str]:
    yield f"[{header}]"
    for key in type(table).model_fields:
        yield from _entry(key, getattr(table, key))


def _entry(key: str, value: object) -> Iterator[str]:
    if value is not None:
        text = _toml(value)
        yield f"{key} = {text}  # {COMMENTS[key]}"


def _toml(value: object) -> str:
    # Printable text, numbers, booleans and lists of them have the same form in JSON.
    return json.dumps(value, ensure_ascii=False)
