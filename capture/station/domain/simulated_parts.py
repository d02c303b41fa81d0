"""The parts below the camera of a simulated rig, drawn from a seed."""

import random
from dataclasses import dataclass

from capture.station.domain.config import SimulatedParts
from rig import Defect, Placement

# Surfaces are periodic, with periods below this: every patch is equally likely.
_MAX_SHIFT_PX = 4096.0
# Size of a defect as a share of the frame: from barely visible to obvious.
_SIZE_SHARES = (0.08, 0.3)
# Depth of a defect as a share of its size: up to a slope of about 1 at its flanks.
_DEPTH_PER_SIZE = (0.05, 0.25)
# Bounds of the fields of `Defect`; only very small and very large frames reach them.
_SIZES_PX, _DEEPEST_PX = (2.0, 2048.0), 256.0
_CONTRASTS = (0.2, 0.6)
# The centre of a defect stays within this share of the frame, around the centre of the frame.
_MIDDLE_SHARE = 0.6


@dataclass(frozen=True)
class SimulatedPart:
    """One part of the feed."""

    placement: Placement
    is_other: bool  # whether its surface is an unexpected one

    @property
    def is_good(self) -> bool:
        """Whether the part has an expected surface and no defect."""
        return not self.is_other and not self.placement.defects


def simulated_part(parts: SimulatedParts, number: int, frame_px: int) -> SimulatedPart:
    """Return the part with a number, which is the same in every run."""
    draw = random.Random(f"{parts.seed} {number}")
    is_other = draw.random() < parts.share_other
    surface = draw.choice(parts.others if is_other else parts.surfaces)
    shift_px = _symmetric(draw, _MAX_SHIFT_PX), _symmetric(draw, _MAX_SHIFT_PX)
    defects: tuple[Defect, ...] = ()
    if not is_other and draw.random() < parts.share_defective:
        defects = (_defect(draw, parts, surface, shift_px, frame_px),)
    any_deg = draw.uniform(0.0, 360.0)
    placement = Placement(
        surface=surface,
        rotate_deg=draw.choice(parts.orientations_deg) if parts.orientations_deg else any_deg,
        shift_px=shift_px,
        # All parts show one realisation of a surface: another takes ten times as long to render.
        seed=parts.seed,
        defects=defects,
    )
    return SimulatedPart(placement, is_other)


def _defect(
    draw: random.Random,
    parts: SimulatedParts,
    surface: str,
    shift_px: tuple[float, float],
    frame_px: int,
) -> Defect:
    """Draw a defect that lies within a frame around `shift_px`."""
    kind = draw.choice(parts.defects)
    size_px = min(max(frame_px * draw.uniform(*_SIZE_SHARES), _SIZES_PX[0]), _SIZES_PX[1])
    half_px = frame_px * _MIDDLE_SHARE / 2.0
    other_surfaces = [other for other in (*parts.others, *parts.surfaces) if other != surface]
    if kind == "foreign" and not other_surfaces:
        kind = "missing"
    return Defect(
        kind=kind,
        x_px=shift_px[0] + _symmetric(draw, half_px),
        y_px=shift_px[1] + _symmetric(draw, half_px),
        size_px=size_px,
        depth_px=min(size_px * draw.uniform(*_DEPTH_PER_SIZE), _DEEPEST_PX),
        angle_deg=draw.uniform(0.0, 180.0),
        contrast=draw.uniform(*_CONTRASTS),
        surface=draw.choice(other_surfaces) if kind == "foreign" else None,
    )


def _symmetric(draw: random.Random, largest: float) -> float:
    return draw.uniform(-largest, largest)
