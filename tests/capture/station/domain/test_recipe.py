"""Tests of `Recipe` and its file."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from capture.station.domain.errors import RecipeError
from capture.station.domain.recipe import (
    Approval,
    GeneralLimits,
    Limits,
    Orientation,
    Recipe,
    Region,
    require_approved,
)
from capture.station.domain.recipe_file import read_recipe, write_recipe
from classify.base.errors import ConfigError, InputError

# No lower-case "unknown" and no surrogates; the rule for labels is tested elsewhere.
LABELS = st.text(st.characters(categories=("L", "N", "P", "Zs")), min_size=1, max_size=20).filter(
    lambda text: text.isprintable() and text.strip().casefold() != "unknown"
)
POSITIVE = st.floats(1e-6, 1e6)
LIMITS = st.builds(
    Limits,
    distance=st.none() | POSITIVE,
    margin=st.none() | st.floats(0.0, 1.0),
    sdq=st.none() | st.tuples(st.floats(0.0, 0.5), st.floats(0.6, 5.0)),
    defect=st.none() | POSITIVE,
)


@st.composite
def recipes(draw: st.DrawFn) -> Recipe:
    textures = draw(st.lists(LABELS, min_size=1, max_size=5, unique=True))
    passing = draw(st.integers(1, len(textures)))
    return Recipe(
        name="sheet",
        note=draw(st.none() | LABELS),
        passes=tuple(textures[:passing]),
        fails=tuple(textures[passing:]),
        orientation=Orientation(tolerance_deg=draw(st.none() | st.floats(0.1, 180.0))),
        limits_of={textures[0]: draw(LIMITS)},
        region=draw(st.none() | st.just(Region(x=1, y=2, width=300, height=400))),
    )


@given(recipes())
def test_a_recipe_is_read_from_its_file_as_it_was_written(
    tmp_path_factory: pytest.TempPathFactory, recipe: Recipe
) -> None:
    path = tmp_path_factory.mktemp("recipes") / "sheet.toml"
    approval = Approval(by="Ada", utc="2026-01-01T00:00:00Z", sha256=recipe.sha256)
    approved = recipe.model_copy(update={"approval": approval})
    write_recipe(path, approved)
    read = read_recipe(path)
    assert read == approved
    assert read.sha256 == recipe.sha256
    require_approved(read)


def test_any_change_needs_a_new_approval() -> None:
    recipe = Recipe(name="sheet", passes=("steel",))
    approval = Approval(by="Ada", utc="2026-01-01T00:00:00Z", sha256=recipe.sha256)
    changed = recipe.model_copy(update={"limits": GeneralLimits(defect=2.0), "approval": approval})
    with pytest.raises(RecipeError, match="sheet, version 1, was changed since it was approved"):
        require_approved(changed)
    with pytest.raises(RecipeError, match="is not approved"):
        require_approved(recipe)


def test_the_limits_of_a_texture_replace_those_of_all() -> None:
    recipe = Recipe(
        name="sheet",
        passes=("steel", "tin"),
        limits=GeneralLimits(distance=2.0, margin=0.2),
        limits_of={"tin": Limits(distance=3.0)},
    )
    assert recipe.limits_for("tin").distance == 3.0
    assert recipe.limits_for("tin") == Limits(**{**dict(recipe.limits), "distance": 3.0})
    assert recipe.limits_for("steel") == Limits(**dict(recipe.limits))


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ('pas = ["a"]', "pas = .* unknown key; did you mean pass"),
        ('pass = ["steel", "steel"]', "'steel' is named twice"),
        ('pass = ["unknown"]', "'unknown' stands for a surface that matches no class"),
        ('name = "other"', "must be the name of the file"),
        ("limits.sdq = [2, 1]", "give the least and the largest value"),
        ("limits.distance = inf", "limits.distance = Infinity: must be a finite number"),
        ("limits.sdq = [0.1, nan]", "limits.sdq.1 = NaN: must be a finite number"),
        ("orientation.tolerance_deg = nan", "tolerance_deg = NaN: must be a finite number"),
        ("light.exposure_ms = nan", "light.exposure_ms = NaN: must be a finite number"),
        ("limits_of.tin.defect = 1", "limits_of.tin: is not in pass"),
    ],
)
def test_a_wrong_value_is_named_in_one_line(tmp_path: Path, line: str, message: str) -> None:
    key = line.split(" ")[0]
    given = [f"{name} = {text}" for name, text in GIVEN.items() if name != key]
    path = tmp_path / "sheet.toml"
    path.write_text("\n".join([*given, line]))
    with pytest.raises(InputError, match=message) as raised:
        read_recipe(path)
    assert "\n" not in str(raised.value)


GIVEN = {"name": '"sheet"', "pass": '["steel"]'}


def test_a_missing_recipe_says_how_to_make_one(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no such recipe; ps4rig station teach makes one"):
        read_recipe(tmp_path / "sheet.toml")


def test_a_recipe_explains_its_keys(tmp_path: Path) -> None:
    write_recipe(tmp_path / "sheet.toml", Recipe(name="sheet", passes=("steel",)))
    text = (tmp_path / "sheet.toml").read_text(encoding="utf-8")
    assert 'pass = ["steel"]  # textures of good parts' in text
