"""Scenes of the simulated rig: a placed surface, rendered under the rig's lights."""

from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import fields, replace
from pathlib import Path
from threading import Lock
from typing import Generic, TypeVar

import numpy as np

from classify.base.errors import InputError
from rig.config.rig import RigConfig
from rig.config.simulation import Placement
from rig.scene.material_folder import bundled_materials, load_material
from rig.scene.render import DISTANT, Lens, SceneImages, render_frame
from rig.scene.surfaces import PeriodicSurface, Surface
from rig.scene.synthetic import SYNTHETIC_NAMES, SYNTHETIC_TEXTURES, synthetic_surface, tile_side_px
from rig.scene.targets import TARGETS, Sphere, target_named

from .defective_surface import DefectiveSurface

_Value = TypeVar("_Value")

_CACHE_BYTES = 64_000_000  # one scene of 1024 x 1024 px with four lights, or many small ones
# A bare LED chip follows Lambert's law.
_LED_LOBE_EXPONENT = 1.0


def surface_names() -> tuple[str, ...]:
    """Names of built-in textures: the four of the thesis, then bundled materials.

    The other names in `SYNTHETIC_TEXTURES`, and the calibration targets in `TARGETS`, need no
    material folder either.
    """
    return (*SYNTHETIC_NAMES, *bundled_materials())


def require_surface(name: str) -> None:
    """Check that there is a surface of this name, without loading it."""
    names = (*SYNTHETIC_TEXTURES, *bundled_materials(), *TARGETS)
    if name not in names and not Path(name).is_dir():
        raise InputError(
            f"surface {name!r} is neither a material folder nor one of {', '.join(names)}"
        )


class BoundedCache(Generic[_Value]):
    """A thread-safe cache of at most `limit_bytes`, which drops least recently used values."""

    def __init__(self, bytes_of: Callable[[_Value], int], limit_bytes: int = _CACHE_BYTES) -> None:
        self._bytes_of, self._limit_bytes = bytes_of, limit_bytes
        self._values: OrderedDict[Hashable, _Value] = OrderedDict()
        self._total_bytes = 0
        self._lock = Lock()

    def get(self, key: Hashable, make: Callable[[], _Value]) -> _Value:
        """The value of `key`, made if it is not kept."""
        with self._lock:
            if key not in self._values:
                self._values[key] = make()
                self._total_bytes += self._bytes_of(self._values[key])
            self._values.move_to_end(key)
            value = self._values[key]
            while self._total_bytes > self._limit_bytes:
                self._total_bytes -= self._bytes_of(self._values.popitem(last=False)[1])
            return value


class SceneRenderer:
    """A renderer of the scenes below one rig's camera; material folders are not cached."""

    def __init__(self, config: RigConfig, cache: BoundedCache[SceneImages] | None = None) -> None:
        self._config = config
        self._cache = _SHARED_CACHE if cache is None else cache
        self._surface: tuple[tuple[object, ...], Surface] | None = None

    def render(self, placement: Placement) -> SceneImages:
        """The scene of a placed surface, in the size of the camera's frames."""
        names = {placement.surface, *(defect.surface for defect in placement.defects)}
        if not names <= {*SYNTHETIC_TEXTURES, *bundled_materials(), *TARGETS, None}:
            return self._render(placement)
        camera, simulated = self._config.camera, self._config.simulation
        optics = (
            simulated.ambient,
            simulated.led_distance_px,
            simulated.led_levels,
            simulated.vignetting_percent,
            simulated.mm_per_px,
        )
        key = (placement, self._config.lights, camera.width_px, camera.height_px, optics)
        return self._cache.get(key, lambda: self._render(placement))

    def _render(self, placement: Placement) -> SceneImages:
        camera, simulated = self._config.camera, self._config.simulation
        size_px = max(camera.width_px, camera.height_px)
        surface = self._surface_of(placement, size_px)
        distance_px = simulated.led_distance_px
        scene = render_frame(
            self._with_defects(surface, placement, size_px),
            self._config.lights.lighting,
            size_px,
            placement.rotate_deg,
            placement.shift_px,
            simulated.ambient,
            led_distance_px=DISTANT if distance_px is None else distance_px,
            lobe_exponent=_LED_LOBE_EXPONENT,
            gloss=surface.gloss if isinstance(surface, Sphere) else None,
        )
        if isinstance(surface, Sphere):
            scene = surface.reflecting_room(scene, simulated.ambient)
        scene = scene.cropped(camera.height_px, camera.width_px)
        if simulated.led_levels:
            levels = np.array(simulated.led_levels, np.float32)
            scene = replace(scene, lights=scene.lights * levels[:, None, None])
        if simulated.vignetting_percent:
            scene = Lens(vignetting=0.01 * simulated.vignetting_percent).images(scene)
        return scene

    def _with_defects(self, surface: Surface, placement: Placement, size_px: int) -> Surface:
        if not placement.defects:
            return surface
        names = {defect.surface for defect in placement.defects if defect.surface is not None}
        for name in names & {*TARGETS}:
            raise InputError(
                f"simulation.placement.defects: surface {name!r} is a calibration target; give a "
                "texture or a material folder"
            )
        foreign = {name: _load(name, placement.seed, size_px) for name in names}
        return DefectiveSurface(surface, placement.defects, foreign)

    def _surface_of(self, placement: Placement, size_px: int) -> Surface:
        name, camera = placement.surface, self._config.camera
        if name in TARGETS:
            field_px = (camera.height_px, camera.width_px)
            mm_per_px = self._config.simulation.mm_per_px
            return target_named(name, field_px, placement.seed, mm_per_px, placement.size_mm)
        key: tuple[object, ...] = (name,)
        if name in SYNTHETIC_TEXTURES:
            key = (name, placement.seed, size_px)
        # The last surface is kept, because it is often captured at many orientations.
        if self._surface is None or self._surface[0] != key:
            self._surface = (key, _load(name, placement.seed, size_px))
        return self._surface[1]


def scene_bytes(scene: SceneImages) -> int:
    """Memory of a scene."""
    arrays = (getattr(scene, field.name) for field in fields(scene))
    # A cropped image keeps the memory of the whole one.
    return sum((array if array.base is None else array.base).nbytes for array in arrays)


def _surface_bytes(surface: PeriodicSurface) -> int:
    maps = (surface.height, surface.p, surface.q, surface.albedo)
    # The spline coefficients have twice as many rows and columns.
    return 5 * sum(plane.nbytes for plane in maps)


# Rendering takes most of the time to open a simulated rig.
_SHARED_CACHE = BoundedCache(scene_bytes)
# Holds synthetic surfaces of frames up to 256 px; larger ones exceed its limit.
_SYNTHETIC_CACHE = BoundedCache(_surface_bytes)


def _load(name: str, seed: int, size_px: int) -> Surface:
    if name in SYNTHETIC_TEXTURES:
        tile_px = tile_side_px(size_px)
        return _SYNTHETIC_CACHE.get(
            (name, seed, tile_px), lambda: synthetic_surface(name, seed, tile_px)
        )
    require_surface(name)
    return load_material(bundled_materials().get(name, Path(name)))
