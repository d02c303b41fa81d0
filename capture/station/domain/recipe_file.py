"""Read and write a recipe: TOML with a comment for every key."""

import json
from collections.abc import Iterator
from pathlib import Path

from capture.station.domain.errors import RecipeError
from classify.base.durable_file import durable_file
from classify.base.section import Section
from rig.config.toml_file import read_toml_as

from .recipe import Recipe

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
COMMENTS = {
    "version": "raised by each teaching",
    "pass": "textures of good parts",
    "fail": "textures of known bad parts; those in neither list fail too",
    "tolerance_deg": "largest departure from reference_deg",
    "reference_deg": "anticlockwise, with the zero of the taught parts",
    "full_turn": "whether a part at reference_deg + 180 is wrong",
    "distance": "largest distance to the texture, beside the library's limit",
    "margin": "least margin to the next texture, beside the library's 0.15",
    "sdq": "least and largest root mean square slope (ISO 25178-2)",
    "shadow_fraction": "largest share of pixels that a light does not reach",
    "unmeasured_fraction": "largest share of pixels without a slope",
    "blur_px": "largest blur against the taught parts",
    "albedo": "least and largest mean albedo, a share of full scale at the taught exposure",
    "scale": "least and largest size of the texture against the taught one",
    "handedness": "least handedness: 1 as taught, -1 in a mirror",
    "octaves": "largest departure of the power in an octave; 1 is the taught limit",
    "window": "largest score of a window of 32 to 128 px; 1 is the taught limit",
    "seam": "largest score of the directions in a window; 1 is the taught limit",
    "defect": "largest score of the defect map; 1 is the taught threshold",
    "unjudged_px": "largest area without a score in the defect map, in px",
    "exposure_ms": "instead of that in rig.toml",
    "required": "whether a part without a calibration is an error",
    "max_age_days": "greatest age of the calibration",
    "acknowledged": "faults of a fifth of the frame that pass, known to whoever approves",
    "taught": "hash of what teaching measured",
    "sha256": "hash of the recipe that was approved",
}
"""What the keys of a recipe mean."""
SECTIONS = {
    "orientation": "How a part must lie. Without tolerance_deg every orientation passes.",
    "limits": "Limits of all textures.",
    "limits_of": "Limits of one texture, in place of those above.",
    "region": "Part of the image that is judged: column and row of its corner, and its size, in px",
    "light": "Settings of the camera for this recipe.",
    "calibration": "",
    "approval": "Written by ps4rig station approve.",
}
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
            tables = {f"{section}.{_toml(name)}": each for name, each in value.items()}
        else:
            tables = {} if value is None else {section: value}
        for number, (header, table) in enumerate(tables.items()):
            yield ""
            if comment and number == 0:
                yield f"# {comment}"
            yield from _table(header, table)


def _table(header: str, table: Section) -> Iterator[str]:
    yield f"[{header}]"
    for key in type(table).model_fields:
        yield from _entry(key, getattr(table, key))


def _entry(key: str, value: object) -> Iterator[str]:
    if value is not None:
        text = _toml(value)
        comment = COMMENTS.get(key)
        yield f"{key} = {text}" + (f"  # {comment}" if comment else "")


def _toml(value: object) -> str:
    # Printable text, numbers, booleans and lists of them have the same form in JSON.
    return json.dumps(value, ensure_ascii=False)
