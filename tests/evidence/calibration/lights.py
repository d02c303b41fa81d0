"""Errors of light positions from a white sheet, and of light directions from spheres."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from capture.calibration.ps4cal import CalibrationFile
from capture.procedures.target_parts import images_of_sets, sphere_parts
from classify.calibration.calibration import CalibratedLights
from classify.calibration.spheres import SphereKind
from classify.lighting import angles_between_deg
from rig import Placement, open_rig

from .rigs import Conditions, captured_targets

# One placement for distant LEDs, and for near ones four around the middle of the frame.
_APART = 0.15  # of the side of the frame
_AROUND = ((1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0))
_SPHERE_SHARE = 0.5  # of the side: at every placement the ball is within the frame


@dataclass(frozen=True)
class LightErrors:
    """Largest errors of the lights of a rig, and their stated standard errors.

    Attributes
    ----------
    target
        What the lights were measured with.
    fields, camera
        As in `Conditions`.
    direction_deg, stated_direction_deg
        Angle between the direction from the middle of the frame and the true one.
    distance_pct, stated_distance_pct
        Error of the distance in percent of it; None for distant lights.
    """

    target: str
    fields: float | None
    camera: str
    direction_deg: float
    stated_direction_deg: float
    distance_pct: float | None
    stated_distance_pct: float | None


def light_errors(conditions: Conditions, lights: CalibratedLights) -> LightErrors:
    """Compare measured lights with those of the simulated rig."""
    true = conditions.faulty.lights.lighting.directions
    positions_px, true_px = lights.lighting.positions_px, conditions.led_distance_px
    distance_pct = stated_pct = None
    if positions_px is not None and true_px is not None:
        shares = np.linalg.norm(positions_px, axis=1) / true_px - 1.0
        distance_pct = float(100.0 * np.abs(shares).max())
    if lights.distance_errors is not None:
        stated_pct = float(100.0 * lights.distance_errors.max())
    return LightErrors(
        lights.source,
        conditions.fields,
        conditions.camera,
        float(angles_between_deg(lights.lighting.directions, true).max()),
        float(lights.direction_errors_deg.max()),
        distance_pct,
        stated_pct,
    )


def sphere_errors(kind: SphereKind, conditions: Conditions, file: CalibrationFile) -> LightErrors:
    """Measure the lights of a calibrated rig by a sphere; positions where they are near."""
    size_px = conditions.size_px
    offsets = ((0.0, 0.0),) if conditions.fields is None else _AROUND
    placements = [
        Placement(
            surface=f"{kind}_sphere",
            shift_px=(_APART * size_px * x, _APART * size_px * y),
            size_mm=_SPHERE_SHARE * size_px,
        )
        for x, y in offsets
    ]
    with open_rig(conditions.faulty.with_changes(simulation={"mm_per_px": 1.0})) as rig:
        sets = list(captured_targets(rig, placements))
    pictures = images_of_sets(sets, file)
    (part,) = sphere_parts(pictures, kind, file, sets[0].setting, ("captured",))
    return light_errors(conditions, part.part)
