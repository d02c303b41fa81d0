"""The table of limits: a field and a row are all that a new measure needs."""

import math
import subprocess
import sys
from pathlib import Path

import pytest

from capture.station.domain import limits
from capture.station.domain.limits import distinct_texts

TABLE = Path(limits.__file__)
FIELD = "    unjudged_px: int | None = None\n"
NEW_FIELD = "    gloss: float | None = None\n"
ROW = "    @model_validator"
NEW_ROW = """\
    gloss: Annotated[
        _Share | None,
        LimitRow("gloss", "largest", Cause.ALBEDO, ".2f", in_reason=True),
    ] = Field(default=None, description="largest gloss")

"""
# The verdict, the recipe's file and form, the row and the column of the results, the part's page.
NEW_MEASURE = """
import sys, types
from pathlib import Path
from capture.station import domain
module = types.ModuleType("capture.station.domain.limits")
module.__package__ = domain.__name__
sys.modules[module.__name__] = domain.limits = module
exec(sys.stdin.read(), vars(module))

from capture.station.domain.recipe import Recipe
from capture.station.domain.recipe_file import write_recipe
from capture.station.judge.judge import Measures, verdict_of
from capture.station.panel.result_pages import measured_numbers
from capture.station.panel.recipes.recipe_form import RecipeForm
from capture.station.results.history import COLUMNS
from capture.station.results.part_result import PartResult, result_of
from capture.station.results.schema import results
from classify import Match

recipe = Recipe.model_validate({"name": "a", "pass": ["b"], "limits": {"gloss": 0.5}})
path = Path(sys.argv[1])
write_recipe(path, recipe)
assert "gloss = 0.5  # largest gloss" in path.read_text()
assert "limits.gloss" in [field.name for section in RecipeForm(recipe).sections()
                          for field in section.fields]
match = Match("b", "b", 0.0, 0.1, None, None, None, limit=1.0, blur_px=0.1)
given = {"unmeasured_fraction": 0.0, "octaves": 0.0, "window": 0.0, "seam": 0.0,
         "defect_score": 0.0, "unjudged_px": 0, "saturated_fraction": 0.0, "match": match,
         "led_levels": (("LED 0", 1.0),)}
verdict = verdict_of(recipe, Measures(**given, gloss=0.7))
print(verdict.decision, verdict.reason)
good = verdict_of(recipe, Measures(**given, gloss=0.4)).reason
assert "gloss 0.40 of 0.50" in good, good
utc = "2026-11-22T17:08:13.042Z"
result = PartResult("line", "part-1", 1, "timer", utc, None, utc, verdict, None, False, "1",
                    label="b", gloss=0.7)
assert result_of(result.row) == result
assert "gloss" in results.c and "gloss" in COLUMNS
[number] = [number for number in measured_numbers(result, recipe) if number.name == "gloss"]
print(number.value, number.limit, number.is_beyond)
"""


def test_a_new_measure_is_a_field_and_a_row_in_one_file(tmp_path: Path) -> None:
    table = TABLE.read_text(encoding="utf-8")
    assert (table.count(FIELD), table.count(ROW)) == (1, 1)
    table = table.replace(FIELD, FIELD + NEW_FIELD).replace(ROW, NEW_ROW + ROW)
    command = [sys.executable, "-c", NEW_MEASURE, str(tmp_path / "a.toml")]
    answer = subprocess.run(command, input=table, text=True, capture_output=True, check=False)
    assert answer.stderr == ""
    assert answer.stdout.splitlines() == [
        "FAIL gloss 0.70, at most 0.50",
        "0.70 at most 0.50 True",
    ]


@pytest.mark.parametrize(
    ("value", "bound", "form", "texts"),
    [
        (3.1, 1.0, ".2f", ("3.10", "1.00")),
        (1.004, 1.0, ".2f", ("1.004", "1.000")),
        (1.0 + 1e-9, 1.0, ".2f", ("1.000000001", "1.000000000")),
        (1.0, 1.0, ".2f", ("1.00", "1.00")),
        (0.05004, 0.05, ".1%", ("5.004%", "5.000%")),
        (12.04, 12.0, ".1f", ("12.04", "12.00")),
        (math.inf, 1.0, ".2f", ("inf", "1.00")),
        (math.nextafter(1e-30, 1.0), 1e-30, ".2f", ("0." + "0" * 17, "0." + "0" * 17)),
    ],
)
def test_a_number_beyond_its_limit_has_the_digits_that_tell_them_apart(
    value: float, bound: float, form: str, texts: tuple[str, str]
) -> None:
    assert distinct_texts(value, bound, form) == texts
