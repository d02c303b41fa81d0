"""The form of the settings of a recipe, without a panel."""

import pytest

from capture.station.domain.recipe import Recipe
from capture.station.panel.recipes.recipe_form import RecipeForm, settings_of

RECIPE = Recipe(name="sheet", passes=("steel",), fails=("rust",))


@pytest.mark.parametrize("given", [{}, {"use.1": ""}, {"use.1": "PASS"}, {"use.1": "good"}])
def test_a_texture_passes_only_if_the_form_says_so(given: dict[str, str]) -> None:
    settings = settings_of(RECIPE, {"use.0": "pass", **given})
    assert (settings["pass"], settings["fail"]) == (["steel"], ["rust"])
    assert [each.is_good for each in RecipeForm(RECIPE, given).textures()] == [False, False]


def test_acknowledged_faults_are_texts_between_commas() -> None:
    assert settings_of(RECIPE, {"acknowledged": " dent, stain of 30 %,"})["acknowledged"] == [
        "dent",
        "stain of 30 %",
    ]
    recipe = RECIPE.model_copy(update={"acknowledged": ("dent", "hole")})
    field = RecipeForm(recipe).sections()[0].fields[1]
    assert (field.kind, field.value) == ("text", "dent, hole")
