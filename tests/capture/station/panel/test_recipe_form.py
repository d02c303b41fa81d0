"""The form of the settings of a recipe, without a panel."""

import pytest

from capture.station.domain.limits import GeneralLimits, Limits
from capture.station.domain.recipe import Recipe
from capture.station.judge.recipe_settings import SettingsRefused, with_settings
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


def test_a_number_is_shown_with_four_digits_and_kept_with_all_if_nobody_changes_it() -> None:
    exact = 0.06072058624977393
    recipe = RECIPE.model_copy(
        update={
            "limits": GeneralLimits(unmeasured_fraction=exact),
            "limits_of": {"steel": Limits(sdq=(exact, 12345.678))},
        }
    )
    shown = {
        field.name: field.value for section in RecipeForm(recipe).sections()
        for field in section.fields
    }  # fmt: skip
    assert shown["limits.unmeasured_fraction"] == "0.06072"
    assert (shown["limits_of.0.sdq.0"], shown["limits_of.0.sdq.1"]) == ("0.06072", "12350")
    given = shown | {"use.0": "pass", "limits_of.0.sdq.1": "12350.5"}
    settings = settings_of(recipe, given)
    assert settings["limits"]["unmeasured_fraction"] == exact
    assert settings["limits_of"]["steel"]["sdq"] == [exact, 12350.5]


@pytest.mark.parametrize("text", ["1_000", "\uff11\uff12", "1_0.5"])
def test_numbers_are_ascii_digits_without_underscores(text: str) -> None:
    settings = settings_of(RECIPE, {"use.0": "pass", "light.exposure_ms": text, "light.gain": "+7"})
    assert settings["light"] == {"exposure_ms": text, "gain": 7}
    with pytest.raises(SettingsRefused, match=r"exposure_ms: must be a .*number"):
        with_settings(RECIPE, settings)


def test_a_number_with_a_comma_is_answered_with_what_to_write() -> None:
    given = {"use.0": "pass", "light.exposure_ms": " 22,5 ", "limits_of.0.sdq.0": "1,x"}
    assert settings_of(RECIPE, given)["light"]["exposure_ms"] == "22,5"
    messages = {("light", "exposure_ms"): "no", ("limits_of", "steel", "sdq", 0): "no"}
    fields = {
        field.name: field.message
        for section in RecipeForm(RECIPE, given, messages).sections()
        for field in section.fields
    }
    assert fields["light.exposure_ms"] == "write 22.5"
    assert fields["limits_of.0.sdq.0"] == "no"


def test_a_fault_of_the_whole_recipe_has_a_name() -> None:
    message = "limits_of.gold: is not in pass; leave these limits out"
    with pytest.raises(SettingsRefused, match=f"^recipe: {message}") as refused:
        with_settings(RECIPE, {"limits_of": {"gold": {"defect": 2.0}}})
    form = RecipeForm(RECIPE, {}, refused.value.messages)
    form.sections()
    assert form.other_messages() == [f"recipe: {message}"]
