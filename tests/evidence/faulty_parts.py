"""Good parts of a material, and parts with faults that a person sees at once, captured as sets."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal
from unittest import mock

import cv2
import numpy as np

from capture import CapturedSet, capture_set
from classify.base.arrays import FloatMap
from rig import Placement, RigConfig, open_rig
from rig.config.simulation import Defect, DefectKind
from rig.scene.material_folder import load_material
from rig.scene.surfaces import PeriodicSurface, Surface, SurfacePatch, View

SIDE_PX = 512
# Pixels over which the edges of a strip and of a seam change.
_EDGE_PX = 2.0
# The middle of a fault stays within this distance of the middle of the frame.
_MIDDLE_PX = 130.0

# Standard deviation of the Gaussian mean of relief that is polished, and of washed out albedo.
_SMOOTHING_PX = 3.0

Change = Literal["strip", "polished", "washed", "seam", "mirrored", "scaled", "darker", "relief"]


@dataclass(frozen=True)
class Fault:
    """A fault: a defect of the simulated rig, or a change of the whole surface, with its strength.

    `most` is the largest share of such parts that may pass; None for a row without a target.
    """

    name: str
    kind: DefectKind | Change | None
    strength: float = 0.0
    most: float | None = 0.0


GOOD = Fault("good", None, most=None)
FAULTS = (
    Fault("missing, 40 px", "missing", 40.0, 0.05),
    Fault("missing, 80 px", "missing", 80.0),
    Fault("stain, 60 px, 30 %", "stain", 60.0),
    Fault("dent, 40 px, 4 px deep", "dent", 40.0),
    Fault("worn strip, 26 px", "strip", 26.0),
    Fault("seam, 90 degrees", "seam", 90.0),
    Fault("mirrored", "mirrored"),
    Fault("5 % smaller", "scaled", 0.95, 0.05),
    Fault("5 % larger", "scaled", 1.05, 0.05),
    Fault("10 % smaller", "scaled", 0.9),
    Fault("10 % larger", "scaled", 1.1),
    Fault("reflectance 50 %", "darker", 0.5),
    Fault("relief 20 % flatter", "relief", 0.8, 0.05),
    Fault("relief 20 % deeper", "relief", 1.2, 0.05),
    Fault("polished, 60 px", "polished", 60.0, None),
    Fault("washed out, 60 px", "washed", 60.0, None),
)


LOCAL = ("missing", "stain", "dent", "strip", "polished", "washed", "seam")
"""Kinds of faults in one place of a part."""


@dataclass(frozen=True, eq=False)
class _ChangedSurface:
    """A surface with a change that no defect of the simulated rig makes."""

    surface: PeriodicSurface
    fault: Fault
    angle_deg: float
    offset_px: float

    @property
    def relief_px(self) -> float:
        return 1.2 * self.surface.relief_px

    def patch(self, view: View) -> SurfacePatch:
        strength = np.float32(self.fault.strength)
        if self.fault.kind == "scaled":
            view = replace(view, magnification=view.magnification * self.fault.strength)
        patch = self.surface.patch(view)
        if self.fault.kind == "darker":
            return replace(patch, albedo=strength * patch.albedo)
        if self.fault.kind == "relief":
            return replace(
                patch, height=strength * patch.height, p=strength * patch.p, q=strength * patch.q
            )
        x, y = View(view.size_px, margin_px=view.margin_px).part_coordinates()
        angle = np.radians(self.angle_deg)
        across = (np.cos(angle) * x + np.sin(angle) * y - self.offset_px).astype(np.float32)
        if self.fault.kind == "seam":
            other = self.surface.patch(
                replace(view, rotate_deg=view.rotate_deg + self.fault.strength)
            )
            share = np.clip(0.5 + across / np.float32(_EDGE_PX), 0.0, 1.0)
        elif self.fault.kind in ("polished", "washed"):
            names = ("albedo",) if self.fault.kind == "washed" else ("height", "p", "q")
            other = replace(patch, **{name: _smoothed(getattr(patch, name)) for name in names})
            distance = np.hypot(across, (np.cos(angle) * y - np.sin(angle) * x).astype(np.float32))
            share = np.clip((0.5 * strength - distance) / np.float32(_EDGE_PX) + 0.5, 0.0, 1.0)
        else:
            flat = np.zeros_like(patch.p)
            other = SurfacePatch(flat + patch.height.mean(), flat, flat, patch.albedo)
            share = np.clip((0.5 * strength - abs(across)) / np.float32(_EDGE_PX) + 0.5, 0.0, 1.0)
        rows, columns = np.gradient(share)  # the slopes are those of the blended height
        step = other.height - patch.height
        mixed = {
            name: getattr(patch, name) * (1.0 - share) + getattr(other, name) * share + edge
            for name, edge in (
                ("height", 0),
                ("p", columns * step),
                ("q", -rows * step),
                ("albedo", 0),
            )
        }
        return SurfacePatch(**{name: each.astype(np.float32) for name, each in mixed.items()})


def _smoothed(plane: FloatMap) -> FloatMap:
    return np.asarray(cv2.GaussianBlur(plane, (0, 0), _SMOOTHING_PX), np.float32)


def _mirrored(surface: PeriodicSurface) -> PeriodicSurface:
    height, p, q, albedo = (
        np.ascontiguousarray(each[:, ::-1])
        for each in (surface.height, surface.p, surface.q, surface.albedo)
    )
    return PeriodicSurface(height, -p, q, albedo, surface.name)


def placements(
    material: Path, fault: Fault, count: int, seed: int
) -> Iterator[tuple[Surface, Placement]]:
    """Parts at random places and orientations: what is shown, and where."""
    names = [each.name for each in (GOOD, *FAULTS)]
    draw = np.random.default_rng([seed, names.index(fault.name), *material.name.encode()])
    base = load_material(material)
    if fault.kind == "mirrored":
        base = _mirrored(base)
    for number in range(count):
        shift_px = tuple(draw.uniform(-2000.0, 2000.0, 2).tolist())
        x_px, y_px = (np.array(shift_px) + draw.uniform(-_MIDDLE_PX, _MIDDLE_PX, 2)).tolist()
        angle_deg, offset_px = draw.uniform(0.0, 180.0), draw.uniform(-60.0, 60.0)
        defects: tuple[Defect, ...] = ()
        surface: Surface = base
        if fault.kind in ("missing", "stain", "dent"):
            defects = (defect_of(fault, (x_px, y_px), angle_deg),)
        elif fault.kind not in (None, "mirrored"):
            surface = _ChangedSurface(base, fault, angle_deg, offset_px)
        yield (
            surface,
            Placement(
                surface=f"{material} {number}",
                rotate_deg=draw.uniform(0.0, 360.0),
                shift_px=shift_px,
                seed=int(draw.integers(1, 2**31)),
                defects=defects,
            ),
        )


def captured_parts(material: Path, fault: Fault, count: int, seed: int) -> Iterator[CapturedSet]:
    """Capture the parts of these placements, with shadows and noise."""
    surfaces: dict[str, Surface] = {str(material): load_material(material)}
    config = RigConfig().with_changes(
        camera={"width_px": SIDE_PX, "height_px": SIDE_PX},
        simulation={"placement": {"surface": str(material)}},
    )
    with _surfaces(surfaces), open_rig(config) as rig:
        assert rig.simulation is not None
        for surface, placement in placements(material, fault, count, seed):
            surfaces.clear()
            surfaces[placement.surface] = surface
            rig.simulation.place(placement)
            yield capture_set(rig, label=material.name)


def defect_of(fault: Fault, middle_px: Sequence[float], angle_deg: float) -> Defect:
    """The defect of the simulated rig that a fault is."""
    values = {"kind": fault.kind, "size_px": fault.strength, "angle_deg": angle_deg}
    values |= {"x_px": middle_px[0], "y_px": middle_px[1], "contrast": 0.3, "depth_px": 4.0}
    return Defect.model_validate(values)


@contextmanager
def camera_over(material: Path) -> Iterator[Callable[[Placement], CapturedSet]]:
    """Yield a function that captures a set of a material in a placement."""
    config = RigConfig().with_changes(
        camera={"width_px": SIDE_PX, "height_px": SIDE_PX},
        simulation={"placement": {"surface": str(material)}},
    )
    with _surfaces({str(material): load_material(material)}), open_rig(config) as rig:

        def capture(placement: Placement) -> CapturedSet:
            assert rig.simulation is not None
            rig.simulation.place(placement.model_copy(update={"surface": str(material)}))
            return capture_set(rig, label=material.name)

        yield capture


@contextmanager
def _surfaces(named: Mapping[str, Surface]) -> Iterator[None]:
    """Let the simulated rig find these surfaces by name."""
    with mock.patch("rig.simulation.scenes._load", lambda name, *_: named[name]):
        yield


def kept_parts(folder: Path, material: Path, fault: Fault, count: int, seed: int) -> list[Path]:
    """Captured parts as files; those of an earlier run are used again."""
    place = folder / f"{material.name}-{seed}"
    place.mkdir(parents=True, exist_ok=True)
    name = fault.name.replace(" ", "-").replace(",", "").replace("%", "percent")
    paths = [place / f"{name}-{number}.ome.tif" for number in range(count)]
    if not all(path.exists() for path in paths):
        for path, captured in zip(paths, captured_parts(material, fault, count, seed), strict=True):
            captured.save(path)
    return paths
