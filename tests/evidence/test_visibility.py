"""Whether a fault can be seen is known where it is plain."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from rig.scene.surfaces import PeriodicSurface

from . import faulty_parts, visibility
from .faulty_parts import FAULTS, placements
from .visibility import holes_seen, seen_by_filter

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


def blotched(deviation: float) -> PeriodicSurface:
    """A flat sheet with blots of 5 px, brighter and darker by factors."""
    draw = np.random.default_rng(1)
    blots = cv2.GaussianBlur(draw.normal(size=(SIDE, SIDE)), (0, 0), 2.0)
    logs = blots / blots.std() + draw.normal(0.0, 0.3, blots.shape)
    height = draw.normal(0.0, 0.01, blots.shape)
    return PeriodicSurface.from_height(height, 0.2 * np.exp(deviation * logs), "blotched")


@pytest.mark.parametrize(("deviation", "is_seen"), [(0.1, True), (1.0, False)])
def test_a_stain_is_seen_where_the_texture_varies_less(
    monkeypatch: pytest.MonkeyPatch, deviation: float, is_seen: bool
) -> None:
    for module in (faulty_parts, visibility):
        monkeypatch.setattr(module, "load_material", lambda _: blotched(deviation))
    (stain,) = (fault for fault in FAULTS if fault.kind == "stain")
    _, seen = seen_by_filter(Path("blotched"), stain, 6, 1, good=20)
    assert seen == [is_seen] * 6
