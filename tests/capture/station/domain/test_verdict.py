"""The table of causes: a row is all that a new cause needs."""

import subprocess
import sys
from pathlib import Path

import pytest

from capture.station.domain import verdict

TABLE = Path(verdict.__file__)
LAST_ROW = next(line for line in TABLE.read_text().splitlines() if line.startswith("    WINDOW ="))
# The verdict, the code for a PLC, the reference and a stored row of a part with the cause.
NEW_CAUSE = """
import sys, types
from capture.station import domain
module = types.ModuleType("capture.station.domain.verdict")
sys.modules[module.__name__] = domain.verdict = module
exec(sys.stdin.read(), vars(module))

from capture.station.domain.recipe import Recipe
from capture.station.judge.judge import Finding, Measures, verdict_of
from capture.station.results.part_result import PartResult, result_of
from tests.reference.registers import cause_lines

cause = module.Cause.named("weight")
finding = Finding(cause, "9 g, at least 12 g")
found = verdict_of(Recipe(name="a", passes=("b",)), Measures(), [finding])
utc = "2026-11-22T17:08:13.042Z"
result = PartResult("line", "part-1", 1, "timer", utc, None, utc, found, None, False, "1")
assert result_of(result.row).verdict == found
assert "- 52 `weight` FAIL: too light" in cause_lines()
print(found.decision, found.causes[0].plc_code, found.reason)
"""


def test_a_new_cause_is_a_row_in_one_file() -> None:
    row = '    WEIGHT = "weight", Decision.FAIL, 52, "too light"'
    table = TABLE.read_text().replace(LAST_ROW, f"{LAST_ROW}\n{row}")
    answer = subprocess.run(
        [sys.executable, "-c", NEW_CAUSE], input=table, text=True, capture_output=True, check=False
    )
    assert (answer.stdout, answer.stderr) == ("FAIL 52 9 g, at least 12 g\n", "")


@pytest.mark.parametrize(
    ("row", "fault"),
    [
        ('"weight", Decision.FAIL, 51, "too light"', "weight: code 51 is in use"),
        ('"weight", Decision.FAIL, 19, "too light"', "weight: code 19 of a FAIL"),
        ('"weight", Decision.PASS, 52, "too light"', "PASS"),
        ('"weight", Decision.ERROR, 7, "too light"', "ERROR is graver than window"),
    ],
)
def test_a_wrong_row_is_refused_when_the_table_is_defined(row: str, fault: str) -> None:
    table = TABLE.read_text().replace(LAST_ROW, f"{LAST_ROW}\n    WEIGHT = {row}")
    with pytest.raises(Exception, match=fault) as raised:  # Python 3.11 wraps errors of an Enum
        exec(compile(table, str(TABLE), "exec"), {"__name__": "wrong"})
    assert raised.type in {ValueError, KeyError, RuntimeError}
