"""Whether a fault can be seen is known where it is plain."""

from pathlib import Path

import numpy as np
import pytest

from rig.scene.surfaces import PeriodicSurface

from . import faulty_parts
from .faulty_parts import FAULTS, Fault, placements
from .visibility import holes_seen, least_seen

SIDE, TILE = 512, 128


def tiles(_: Path) -> PeriodicSurface:
    """Flat tiles with a joint at rows and columns 0, 128, 256 ..., and a little noise."""
    distance = np.minimum(np.arange(SIDE) % TILE, -np.arange(SIDE) % TILE)
    joint = 4.0 * np.exp(-0.5 * (distance / 2.0) ** 2)
    height = -np.maximum(joint, joint[:, None])
    height += np.random.default_rng(1).normal(0.0, 0.01, height.shape)
    return PeriodicSurface.from_height(height, np.full(height.shape, 0.5), "tiles")


def test_a_hole_is_seen_where_it_takes_a_joint_away(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(faulty_parts, "load_material", tiles)
    hole, count = FAULTS[0], 12
    assert (hole.kind, hole.strength) == ("missing", 40.0)
    seen = list(holes_seen(Path("tiles"), hole, count, 1))
    for (_, placement), is_seen in zip(
        placements(Path("tiles"), hole, count, 1), seen, strict=True
    ):
        (defect,) = placement.defects
        offsets = (np.array([defect.x_px, -defect.y_px]) + 0.5 * (SIDE - 1)) % TILE
        joint_px = float(np.minimum(offsets, TILE - offsets).min())
        if not 10.0 < joint_px < 25.0:
            assert is_seen == (joint_px <= 10.0), joint_px
    assert {True, False} == set(seen)


def test_a_smaller_fault_can_be_in_more_places_and_needs_a_larger_d() -> None:
    sizes = (16.0, 60.0, 512.0)
    least = [least_seen(Fault("stain", "stain", size_px)) for size_px in sizes]
    assert least == sorted(least, reverse=True)
    assert least[-1] == pytest.approx(2 * 2.326, abs=1e-3)  # one place
