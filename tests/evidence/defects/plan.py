"""The plan of the study of defects: textures, defects, numbers of parts."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

from capture.chapter.plan import Texture
from rig import Defect
from rig.config.simulation import RELIEF_KINDS, DefectKind
from rig.scene.synthetic import SYNTHETIC_NAMES

FALSE_ALARM_RATE = 0.01
"""Share of good parts with an alarm anywhere, for which all detectors set their limits."""

STAIN: tuple[DefectKind, ...] = ("stain",)
KINDS: tuple[DefectKind, ...] = (*RELIEF_KINDS, *STAIN, "missing", "foreign")
_EXAMPLES: tuple[DefectKind, ...] = ("scratch", "dent", "stain", "missing")


class DefectCase(NamedTuple):
    """A kind of defect with its size; depth in pixels, or contrast of a stain."""

    kind: DefectKind
    size_px: float
    strength: float | None = None

    def __str__(self) -> str:
        if self.strength is None:
            return f"{self.kind}, {self.size_px:g} px"
        unit = "contrast" if self.kind == "stain" else "px deep"
        return f"{self.kind}, {self.size_px:g} px, {self.strength:g} {unit}"

    def placed(
        self, place_px: tuple[float, float], angle_deg: float, foreign: str | None
    ) -> Defect:
        """The defect at a place on a part."""
        depth_px = self.strength if self.kind in RELIEF_KINDS else None
        contrast = self.strength if self.kind == "stain" else None
        return Defect(
            kind=self.kind,
            x_px=place_px[0],
            y_px=place_px[1],
            size_px=self.size_px,
            depth_px=depth_px or 1.0,
            contrast=contrast or 0.0,
            angle_deg=angle_deg,
            surface=foreign,
        )


@dataclass(frozen=True)
class DefectPlan:
    """Numbers of a study.

    Attributes
    ----------
    textures
        At least two; the foreign patches of each are of the next one.
    taught
        Numbers of good parts that are taught; each is a study of its own.
    good
        Number of other good parts of each texture, which measure the false alarms.
    sizes_px, depths_px, contrasts
        Every combination is one defective part of each texture.
    """

    textures: tuple[Texture, ...]
    taught: tuple[int, ...]
    good: int
    sizes_px: tuple[float, ...]
    depths_px: tuple[float, ...]
    contrasts: tuple[float, ...]
    quick: bool

    @property
    def cases(self) -> Iterator[DefectCase]:
        """Every defect, each on one part of each texture."""
        for kind in KINDS:
            relief = kind in RELIEF_KINDS
            strengths = self.depths_px if relief else self.contrasts if kind == "stain" else (None,)
            for size_px in self.sizes_px:
                yield from (DefectCase(kind, size_px, strength) for strength in strengths)

    @property
    def examples(self) -> dict[int, DefectCase]:
        """Defects of the pictures by the place of their texture: of middle size, the strongest."""
        size_px = self.sizes_px[len(self.sizes_px) // 2]
        strengths = {"stain": max(self.contrasts), "missing": None}
        return {
            number * len(self.textures) // len(_EXAMPLES): DefectCase(
                kind, size_px, strengths.get(kind, max(self.depths_px))
            )
            for number, kind in enumerate(_EXAMPLES)
        }


def defect_plan(quick: bool, materials: tuple[Texture, ...]) -> DefectPlan:
    """The full plan, or a quick one that takes a minute of one core."""
    if quick:
        synthetic = ("malv", "sand", "weave_dyed")
        materials = materials[:: -(-len(materials) // 3)]
        return DefectPlan(
            textures=(*map(Texture, synthetic), *materials),
            taught=(10,),
            good=10,
            sizes_px=(16.0, 32.0),
            depths_px=(2.0,),
            contrasts=(0.4,),
            quick=True,
        )
    return DefectPlan(
        textures=(*map(Texture, SYNTHETIC_NAMES), *materials),
        taught=(3, 30),
        good=25,
        sizes_px=(16.0, 40.0),
        depths_px=(1.0, 2.0, 4.0),
        contrasts=(0.1, 0.2, 0.4),
        quick=False,
    )
