"""Times of the solvers against the memory floor and against numpy."""

from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from capture.chapter.results import Work, shortest_ms
from classify import Lighting, Method
from rig.simulation.simulated_set import SimulatedSet
from tests.evidence.benchmark.memory_floor import read_four_write_three

from .measurements import Measurement, Section
from .scenes import mosaic, under_near_lights
from .settings import Settings

METHODS: tuple[Method, ...] = ("ps4", "ps4_robust", "least_squares")
# Targets of the project on two cores, at five megapixels.
_MAX_OF_FLOOR, _MIN_OF_LSTSQ, _MAX_OF_DISTANT = 2.0, 100.0, 2.5
# Distance of the near lights.
_FIELDS_OF_VIEW = 5.0

Array = npt.NDArray[Any]


def solver_sections(settings: Settings) -> list[Section]:
    """One section for each pixel depth."""
    return [_section(bits, settings) for bits in (8, 16)]


def _section(bits: int, settings: Settings) -> Section:
    image_set = mosaic(settings.solver_frame_px, bits)
    maps = np.empty((3, *settings.solver_frame_px), np.float32)
    solvers: dict[str, Work] = {method: partial(image_set.solve, method) for method in METHODS}
    near_set = under_near_lights(image_set, _FIELDS_OF_VIEW)
    near: dict[str, Work] = {f"{each}, near": partial(near_set.solve, each) for each in METHODS}
    solvers["ps4 and every other map"] = partial(_compute_every_map, image_set)
    plain: dict[str, Work] = {
        "numpy lstsq": partial(normal_least_squares, image_set.images, image_set.lighting),
        "numpy drop-darkest": partial(drop_darkest, image_set.images, image_set.lighting),
    }
    floor_work: dict[str, Work] = {"floor": partial(read_four_write_three, image_set.images, maps)}
    times = shortest_ms(floor_work | solvers | near, settings.solver_rounds)
    times |= shortest_ms(plain, settings.numpy_rounds)
    floor = times["floor"]
    found = [Measurement("floor: read 4 planes, write 3 float32", 1.0, "x floor", floor)]
    for name in solvers:
        target = _MAX_OF_FLOOR if name == "ps4" else None
        found.append(Measurement(name, times[name] / floor, "x floor", times[name], target))
    for method in METHODS:
        name = f"{method}, near"
        ratio = times[name] / times[method]
        found.append(Measurement(name, ratio, "x distant", times[name], _MAX_OF_DISTANT))
    for name in plain:
        found.append(Measurement(name, times[name] / floor, "x floor", times[name]))
        for method in METHODS:
            target = _MIN_OF_LSTSQ if (name, method) == ("numpy lstsq", "ps4") else None
            ratio = times[name] / times[method]
            found.append(Measurement(name, ratio, f"x {method}", None, target, "at least"))
    return Section(
        f"Solvers, {bits} bit, {maps[0].size / 1e6:.2f} megapixels",
        found,
        (
            f"The shortest of {settings.solver_rounds} calls (numpy: {settings.numpy_rounds}).",
            "The floor writes into the same maps each time, a solver into new ones.",
            f"Near lights stand {_FIELDS_OF_VIEW:g} widths of the frame away.",
            "lstsq: one np.linalg.lstsq of the lights, all pixels as right-hand sides; no slopes.",
        ),
    )


def _compute_every_map(image_set: SimulatedSet) -> None:
    surface = image_set.solve("ps4")
    surface.dropped, surface.residual, surface.shadow_count, surface.saturated  # noqa: B018


def normal_least_squares(images: Array, lighting: Lighting) -> Array:
    """(3, pixels) scaled normals by one call of numpy's least squares."""
    values = images.reshape(len(images), -1)
    normals: Array = np.linalg.lstsq(lighting.directions, values, rcond=None)[0]
    return normals


def drop_darkest(images: Array, lighting: Lighting) -> tuple[Array, Array, Array]:
    """Solve PS4 in plain numpy for p, q and albedo: one inverse for each dropped light."""
    values = images.reshape(len(images), -1).astype(np.float32)
    darkest = values.argmin(axis=0)
    normals = np.empty((3, values.shape[1]), np.float32)
    for light in range(len(images)):
        others = np.delete(np.arange(len(images)), light)
        inverse = np.linalg.inv(lighting.directions[others]).astype(np.float32)
        chosen = darkest == light
        normals[:, chosen] = inverse @ values[others][:, chosen]
    x, y, z = normals
    return -x / z, -y / z, np.linalg.norm(normals, axis=0)
