"""Orientations of a set beside the one that a person entered."""

from dataclasses import replace
from pathlib import Path

import pytest

from capture.session.measures import SpecimenReference, measures_of
from capture.sets.captured_set import LoadedSet


@pytest.mark.parametrize("entered_deg", [50.0, 230.0, -130.0, 100.0])
def test_the_estimate_is_the_equal_orientation_nearest_to_the_entered_one(
    sets: Path, entered_deg: float
) -> None:
    """The sand of the file is at 50 degrees, which is the same as 230 and -130."""
    first, turned = (LoadedSet.of(sets / f"sand-00{number}.ome.tif") for number in (1, 2))
    metadata = turned.captured.metadata.model_copy(update={"orientation_deg": entered_deg})
    entered = replace(turned, captured=replace(turned.captured, metadata=metadata))
    measures = measures_of(entered, SpecimenReference(first))
    nearest_deg = 50.0 if entered_deg == 100.0 else entered_deg
    assert measures.estimated_deg == pytest.approx(nearest_deg, abs=2.0)
    warnings = ("the texture stands at 50 degrees, 100 were entered",)
    assert measures.warnings == (warnings if entered_deg == 100.0 else ())
