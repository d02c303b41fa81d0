"""Limits of textures that people set in a recipe: they stay when it is taught again."""

from collections.abc import Iterator, Mapping

from capture.station.domain.limits import ROWS, Limits
from capture.station.domain.recipe import Recipe
from capture.station.domain.recipe_folder import RecipeFolder
from classify.base.errors import InputError
from classify.base.models import read_toml_as

LimitsOf = Mapping[str, Limits]


def limits_measured_before(files: RecipeFolder, recipe: Recipe) -> LimitsOf | None:
    """Return the limits that the last teaching measured; None if they are missing."""
    path = files.version(recipe.version).measured
    try:
        return read_toml_as(path, Recipe, "was not kept").limits_of
    except InputError:
        return None


def manual_limits(present: LimitsOf, measured: LimitsOf | None) -> LimitsOf:
    """Return the limits of each texture that differ from the `measured` ones.

    Without `measured`, all limits that teaching can measure count as measured.
    """
    manual = {}
    for texture, limits in present.items():
        if measured is None:
            values = {name: value for name, value in limits if not ROWS[name].of_teaching}
        else:
            taught = dict(measured.get(texture, Limits()))
            values = {name: value for name, value in limits if value != taught[name]}
        manual[texture] = Limits.model_validate(values)
    return manual


def with_set_limits(measured: LimitsOf, by_people: LimitsOf) -> dict[str, Limits]:
    """Return measured limits, replaced by the limits that people set."""
    return {
        texture: limits.model_copy(
            update=by_people.get(texture, Limits()).model_dump(exclude_none=True)
        )
        for texture, limits in measured.items()
    }


def kept_remarks(measured: LimitsOf, by_people: LimitsOf) -> Iterator[str]:
    """Yield a remark on each limit that people set, with the measured one."""
    for texture, limits in by_people.items():
        taught = dict(measured.get(texture, Limits()))
        for name, value in limits.model_dump(exclude_none=True).items():
            replaced = taught[name]
            note = "" if replaced is None else f"; the taught parts give {_text(replaced)}"
            yield (
                f"limits_of.{texture}.{name} = {_text(value)} was set by somebody and stays{note}. "
                "Remove it from the recipe and teach again to undo that"
            )


def replaced_remarks(before: LimitsOf, after: LimitsOf) -> Iterator[str]:
    """Yield a remark on each limit that teaching replaced."""
    for texture, limits in before.items():
        now = dict(after.get(texture, Limits()))
        for name, value in limits:
            if value is not None and value != now[name]:
                place = f"limits_of.{texture}.{name}"
                yield f"{place} = {_text(value)} is replaced by {_text(now[name])}"


def _text(value: object) -> str:
    if isinstance(value, tuple | list):
        return ", ".join(map(_text, value))
    return (
        f"{value:.4g}" if isinstance(value, float) else "no limit" if value is None else str(value)
    )
