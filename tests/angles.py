"""Differences of angles."""

import numpy as np

from classify import SurfaceEstimate
from classify.base.arrays import Floats
from classify.lighting import angles_between_deg
from rig.scene.render import SceneImages


def off_deg(found: float, true: float, period_deg: float = 180.0) -> float:
    """Absolute difference of two angles that are equal modulo `period_deg`."""
    half = period_deg / 2.0
    return abs((found - true + half) % period_deg - half)


def normal_errors_deg(scene: SceneImages, surface: SurfaceEstimate) -> Floats:
    """(H, W) angles between the true normals and those found."""
    true = np.stack([-scene.p, -scene.q, np.ones_like(scene.p)], axis=-1)
    return angles_between_deg(true, surface.normals)
