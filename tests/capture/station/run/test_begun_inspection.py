"""An inspection that began while its images were checked counts for these images alone."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from capture import CapturedSet
from capture.sets.metadata import ChecksRecord
from capture.station.domain.recipe_file import RecipeFolder
from capture.station.domain.verdict import Cause
from capture.station.judge.inspector import Inspection, Inspector
from capture.station.judge.measured_surface import MeasuredSurface
from classify.base.errors import InputError
from tests.capture.station.results.parts import minimal
from tests.capture.station.teaching_sets import patch


@pytest.fixture
def inspector(files: RecipeFolder) -> Inspector:
    return Inspector.load(files)


@pytest.fixture(scope="module")
def part() -> CapturedSet:
    return patch("rock", 31)


@pytest.fixture
def solved(monkeypatch: pytest.MonkeyPatch) -> list[CapturedSet]:
    """The sets that were solved."""
    found: list[CapturedSet] = []
    solve: Callable[..., MeasuredSurface] = MeasuredSurface.of

    def of(captured: CapturedSet, *others: object, **options: object) -> MeasuredSurface:
        found.append(captured)
        return solve(captured, *others, **options)

    monkeypatch.setattr(MeasuredSurface, "of", of)
    return found


def unchecked(captured: CapturedSet) -> CapturedSet:
    """The set as `capture_set` gives it before its checks: the same arrays."""
    about = captured.metadata.model_copy(update={"checks": None, "pixels_sha256": ""})
    return replace(captured, metadata=about)


def fields(inspection: Inspection) -> dict[str, object]:
    return vars(inspection.recorded(minimal())) | {"timings_ms": None}


def test_a_begun_part_is_solved_once_with_the_same_result(
    inspector: Inspector, part: CapturedSet, solved: list[CapturedSet]
) -> None:
    plain = fields(inspector.inspect(part))
    solved.clear()
    inspector.begin(unchecked(part))
    assert fields(inspector.inspect(part)) == plain
    assert len(solved) == 1


@pytest.mark.parametrize("changed", ["images", "ambient"])
def test_another_attempt_is_solved_again(
    inspector: Inspector, part: CapturedSet, solved: list[CapturedSet], changed: str
) -> None:
    other = replace(part, **{changed: np.flip(getattr(part, changed), -1).copy()})
    plain = fields(inspector.inspect(other))
    inspector.begin(unchecked(part))
    assert fields(inspector.inspect(other)) == plain
    assert other in solved[1:]


def test_the_error_of_a_begun_part_is_raised_where_it_is_judged(
    inspector: Inspector, part: CapturedSet, monkeypatch: pytest.MonkeyPatch
) -> None:
    def of(*_: object, **__: object) -> MeasuredSurface:
        raise InputError("cannot be solved")

    monkeypatch.setattr(MeasuredSurface, "of", of)
    inspector.begin(unchecked(part))
    with pytest.raises(InputError, match="cannot be solved"):
        inspector.inspect(part)


@pytest.mark.parametrize("level_error", [0.002, 0.02, None])
def test_levels_that_the_images_show_count_instead_of_brightness(
    inspector: Inspector, part: CapturedSet, level_error: float | None
) -> None:
    # A part whose slopes lie to one side gets less light from the other side.
    images = part.images.copy()
    images[2] = images[2] * 0.8
    checks = ChecksRecord(
        ambient_change=None,
        redundancy_residual=0.0,
        light_levels=None if level_error is None else (1.0, 1.0, 0.99, 1.0),
        light_levels_error=level_error,
        retaken=False,
        light_order="undecided",
    )
    leaning = replace(
        part, images=images, metadata=part.metadata.model_copy(update={"checks": checks})
    )
    inspector.begin(unchecked(leaning))
    inspection = inspector.inspect(leaning)
    is_known = level_error == 0.002
    assert (Cause.RIG in inspection.verdict.causes) == (not is_known)
    assert dict(inspection.measures.led_levels)["LED 2 (tilt 180)"] == pytest.approx(
        0.99 if is_known else 0.8, abs=0.03
    )
