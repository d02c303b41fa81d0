"""How much of a surface lies in shadow: figures 9.2 and 9.3."""

from __future__ import annotations

from dataclasses import dataclass

from classify import Lighting
from rig.scene.render import render_frame

from .scenes import Texture, surface_of

__all__ = ["SHADOW_TILTS_DEG", "ShadowTask", "shadow_shares"]

SHADOW_TILTS_DEG = (0.0, 30.0, 60.0, 90.0)


@dataclass(frozen=True)
class ShadowTask:
    """One texture under lights of one slant."""

    texture: Texture
    slant_deg: float
    size_px: int


def shadow_shares(task: ShadowTask) -> tuple[float, ...]:
    """Share of the pixels in attached or cast shadow of a light, for each of the tilts."""
    surface = surface_of(task.texture, 0, task.size_px)
    lighting = Lighting.ring(task.slant_deg, SHADOW_TILTS_DEG)
    scene = render_frame(surface, lighting, task.size_px)
    shares: list[float] = scene.shadowed.mean(axis=(1, 2)).tolist()
    return tuple(shares)
