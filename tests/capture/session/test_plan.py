"""The plan of a session."""

from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from pydantic import ValidationError

from capture.session.plan import SessionPlan, Specimen, example_plan, read_plan
from classify.base.errors import InputError

_SPECIMEN = '\n[[specimen]]\nid = "a"\n'


def plan_of(tmp_path: Path, text: str) -> SessionPlan:
    path = tmp_path / "plan.toml"
    path.write_text(text, encoding="utf-8")
    return read_plan(path)


def test_the_example_is_a_plan_and_its_sets_come_specimen_by_specimen(tmp_path: Path) -> None:
    plan = plan_of(tmp_path, example_plan("fabrics"))
    assert (plan.name, len(plan), plan.exposure_ms) == ("fabrics", 12, None)
    planned = list(plan.sets())
    assert [each.specimen for each in planned] == ["rock-1"] * 6 + ["sand-1"] * 6
    assert planned[1].file_name == "rock-1-30-1.ome.tif"
    assert str(planned[1]) == "rock-1 at 30 degrees"


def test_every_commented_key_of_the_example_is_a_key(tmp_path: Path) -> None:
    lines = example_plan("fabrics").splitlines()
    keys = [line.removeprefix("# ") for line in lines if line.startswith("# ") and " = " in line]
    text = "\n".join(line for line in lines if line not in {f"# {key}" for key in keys})
    assert len(keys) == 7
    head, _, rest = text.partition("[[specimen]]")
    note = [key for key in keys if key.startswith(("note", "properties"))]
    others = [key for key in keys if key not in note]
    plan = plan_of(tmp_path, "\n".join([head, *others, "[[specimen]]", *note, rest]))
    assert plan.turntable_command(30.0) == ["turn-to", "30"]
    assert plan.specimen[0].note == "left corner is worn"
    assert plan.specimen[0].properties == {"mass_g": 12.5, "polished": "2026-05-17"}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("name = ", "not valid TOML"),
        ('name = "../a"\norientations_deg = [0]' + _SPECIMEN, "'../a' "),
        ('name = "a"\norientations_deg = [0, 40, 0]' + _SPECIMEN, "0.0 is named twice"),
        ('name = "a"\norientations_deg = [0]' + _SPECIMEN + _SPECIMEN, "specimen.id: a is named"),
        ('name = "a"\norientations_deg = [0]\nrepeat = 2' + _SPECIMEN, "did you mean repeats"),
        ('name = "a"\norientations_deg = [0]\nexposure_ms = "long"' + _SPECIMEN, "or 'search'"),
        ('name = "a"\norientations_deg = [0]\nturntable = "turn"' + _SPECIMEN, "{angle} where"),
        ('name = "a"\norientations_deg = [0]\nturntable = "turn \'{angle}"' + _SPECIMEN, "quot"),
        ('name = "a"\norientations_deg = [0]\nfile_name = "{angle}"' + _SPECIMEN, "{specimen} is"),
        (
            'name = "a"\norientations_deg = [0]\nfile_name = "{specimen}/{angle}-{repeat}"'
            + _SPECIMEN,
            "becomes part of names",
        ),
        ('name = "a"\norientations_deg = [0]' + _SPECIMEN + 'label = "unknown"', "'unknown' sta"),
        ('name = "a"\noperator = "\\t"\norientations_deg = [0]' + _SPECIMEN, "use printable"),
    ],
)
def test_a_wrong_plan_is_refused_by_name(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(InputError) as caught:
        plan_of(tmp_path, text)
    assert str(caught.value).startswith(f"{tmp_path / 'plan.toml'}: ")
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (r"C:\tools\turn.exe {angle}", [r"C:\tools\turn.exe", "40"]),
        (r'"D:\my tools\turn.exe" --to={angle}', [r"D:\my tools\turn.exe", "--to=40"]),
        (r"my\ turn '{angle} deg' #1", ["my turn", "40 deg", "#1"]),
    ],
)
def test_a_turntable_is_a_command_of_posix_or_of_windows(
    tmp_path: Path, command: str, words: list[str]
) -> None:
    text = f'name = \'a\'\norientations_deg = [40]\nturntable = """{command!s}"""' + _SPECIMEN
    plan = plan_of(tmp_path, text.replace("\\", "\\\\"))
    assert plan.turntable_command(40.0) == words


def test_a_missing_plan_names_the_command_that_writes_one(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="ps4rig session new"):
        read_plan(tmp_path / "none.toml")


@given(
    names=st.lists(
        st.from_regex(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,6}", fullmatch=True),
        min_size=1, max_size=4, unique_by=str.casefold,
    ),
    orientations_deg=st.lists(
        st.integers(-3600, 3600).map(float),
        min_size=1, max_size=4, unique_by=lambda each: each % 360.0,
    ),
    repeats=st.integers(1, 3),
)  # fmt: skip
@example(names=["a", "a-"], orientations_deg=[-1.0, 1.0], repeats=1)
def test_files_of_different_sets_have_different_names(
    names: list[str], orientations_deg: list[float], repeats: int
) -> None:
    try:
        plan = SessionPlan(
            name="a",
            orientations_deg=tuple(orientations_deg),
            repeats=repeats,
            specimen=tuple(Specimen(id=name) for name in names),
        )
    except ValidationError as error:
        assert "would both be" in str(error)  # noqa: PT017 - most plans are good
        return
    files = [planned.file_name for planned in plan.sets()]
    assert len(files) == len(plan)
    # Also on a file system that ignores case.
    assert len({name.casefold() for name in files}) == len(files)
