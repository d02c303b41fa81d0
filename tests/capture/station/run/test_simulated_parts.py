"""The feed of a simulated rig: repeatable, within the frame, with the shares asked for."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from capture.station.domain.config import SimulatedParts
from capture.station.domain.simulated_parts import simulated_part
from rig.config.simulation import DefectKind

KINDS: tuple[DefectKind, ...] = ("scratch", "dent", "bump", "stain", "missing", "foreign")


@given(st.integers(1, 10**9), st.integers(0, 2**31 - 1), st.integers(16, 8192))
def test_a_part_depends_on_seed_and_number_alone(number: int, seed: int, frame_px: int) -> None:
    feed = SimulatedParts(seed=seed, share_defective=0.5, defects=KINDS)
    part = simulated_part(feed, number, frame_px)
    assert part == simulated_part(feed, number, frame_px)
    assert part.is_good == (part.placement.surface == "rock" and not part.placement.defects)
    for defect in part.placement.defects:
        for seen, middle in zip((defect.x_px, defect.y_px), part.placement.shift_px, strict=True):
            assert abs(seen - middle) <= 0.5 * frame_px


def test_shares_are_those_of_the_configuration() -> None:
    feed = SimulatedParts(share_other=0.2, share_defective=0.25, orientations_deg=(0.0, 90.0))
    parts = [simulated_part(feed, number, 64) for number in range(1, 4001)]
    others = sum(part.is_other for part in parts)
    defective = sum(bool(part.placement.defects) for part in parts)
    assert others / 4000 == pytest.approx(0.2, abs=0.03)
    assert defective / 4000 == pytest.approx(0.8 * 0.25, abs=0.03)
    assert {part.placement.rotate_deg for part in parts} == {0.0, 90.0}


def test_shares_need_something_to_draw() -> None:
    with pytest.raises(ValueError, match="others is empty"):
        SimulatedParts(others=())
    with pytest.raises(ValueError, match="defects is empty"):
        SimulatedParts(defects=())
    SimulatedParts(others=(), share_other=0.0, defects=(), share_defective=0.0)
