"""How often a session flags mistyped and correct orientations, over many textures.

    python -m tests.evidence.orientation_flags [--materials DIR] [--quick]

With scanned materials of a folder too it has the figures of capture/README.md. --quick captures two
sets of each texture at 256 px instead of 16 at 512 px.
"""

import argparse
import sys
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from capture import CapturedSet
from capture.session.measures import SpecimenReference, measures_of
from capture.sets.captured_set import LoadedSet
from classify import Lighting, TextureLibrary
from classify.texture.orientation import MIN_SHARPNESS
from rig.scene.material_folder import bundled_materials, load_material
from rig.scene.render import Lens, render_frame
from rig.scene.surfaces import PeriodicSurface
from rig.scene.synthetic import SYNTHETIC_30, synthetic_surface, tile_side_px
from rig.simulation.sensor import SensorModel
from tests.capture.conftest import make_set

from .limits import at_least, at_most

LIGHTING = Lighting.ring(45.0)
SENSOR, EXPOSURE_MS = SensorModel(bit_depth=12), 20.0
# A hand is off by up to so much; every second set is out of focus by up to 0.7 px.
HAND_DEG, MOST_BLUR_PX = 2.0, 0.7
MISTYPED_DEG = 20.0


def textures(
    side_px: int, given: Path | None
) -> Iterator[tuple[str, Callable[[], PeriodicSurface]]]:
    for name in SYNTHETIC_30:
        yield name, partial(synthetic_surface, name, 1, tile_side_px(side_px))
    folders = dict(bundled_materials())
    if given is not None:
        folders |= {path.name: path for path in given.iterdir() if path.is_dir()}
    for name, folder in sorted(folders.items()):
        yield name, partial(load_material, folder)


@dataclass(frozen=True)
class Flags:
    """What was flagged of one texture: shares of correct and of mistyped orientations."""

    sharpness: float
    correct: float
    mistyped: float


class Bench:
    """Sets of a surface, each of another patch of it."""

    def __init__(self, surface: PeriodicSurface, side_px: int, seed: int) -> None:
        self._surface, self._side_px = surface, side_px
        self.rng = np.random.default_rng(seed)

    def captured(self, orientation_deg: float, blur_px: float) -> CapturedSet:
        shift_px = tuple(self.rng.uniform(0.0, len(self._surface.height), 2))
        scene = render_frame(self._surface, LIGHTING, self._side_px, orientation_deg, shift_px)
        scene = Lens(blur_px, 0.0).images(scene)

        def expose(light: np.ndarray) -> np.ndarray:
            return SENSOR.expose(EXPOSURE_MS * light, self.rng)

        pixels = np.stack([expose(light + scene.ambient) for light in scene.lights])
        return make_set(
            pixels, expose(scene.ambient), LIGHTING, bit_depth=12, full_scale=4095,
            orientation_deg=orientation_deg,
        )  # fmt: skip


def entered(captured: CapturedSet, orientation_deg: float) -> LoadedSet:
    about = captured.metadata.model_copy(update={"orientation_deg": orientation_deg})
    return LoadedSet(CapturedSet(captured.images, captured.ambient, about), None)


def flags_of(surface: PeriodicSurface, sets: int, side_px: int, seed: int) -> Flags:
    bench = Bench(surface, side_px, seed)
    first = LoadedSet(bench.captured(0.0, 0.0), None)
    reference = SpecimenReference(first)
    library = TextureLibrary.train([("it", first.solve_texture(None, planar=True), 0.0)])
    correct, mistyped, sharpness = [], [], []
    for number in range(sets):
        true_deg = float(bench.rng.uniform(0.0, 180.0))
        blur_px = float(bench.rng.uniform(0.0, MOST_BLUR_PX)) * (number % 2)
        captured = bench.captured(true_deg, blur_px)
        asked_deg = true_deg + float(bench.rng.uniform(-HAND_DEG, HAND_DEG))
        surface_found = LoadedSet(captured, None).solve_texture(None, planar=True)
        sharpness.append(library.classify(surface_found).sharpness or 0.0)
        for offset_deg, flagged in (
            (0.0, correct),
            (MISTYPED_DEG, mistyped),
            (-MISTYPED_DEG, mistyped),
        ):
            measures = measures_of(entered(captured, asked_deg + offset_deg), reference)
            flagged.append(any("the texture stands at" in said for said in measures.warnings))
    return Flags(float(np.median(sharpness)), float(np.mean(correct)), float(np.mean(mistyped)))


def main(arguments: Sequence[str]) -> int:
    """Print the table; return 1 if too few wrong or too many correct ones are flagged."""
    parser = argparse.ArgumentParser(prog="orientation_flags")
    parser.add_argument("--materials", type=Path)
    parser.add_argument("--quick", action="store_true")
    given = parser.parse_args(arguments)
    sets, side_px = (2, 256) if given.quick else (16, 512)
    found = {
        name: flags_of(make(), sets, side_px, zlib.crc32(name.encode()))
        for name, make in textures(side_px, given.materials)
    }
    for name, flags in sorted(found.items(), key=lambda item: item[1].sharpness):
        print(
            f"{name:24s} sharpness {flags.sharpness:.2f}, flagged: correct {flags.correct:.0%}, "
            f"mistyped {flags.mistyped:.0%}"
        )
    directional = [flags for flags in found.values() if flags.sharpness >= MIN_SHARPNESS]
    print(f"{sets} sets of {side_px} px of each texture")
    are_met = [
        at_least("mistyped flagged", float(np.mean([each.mistyped for each in directional])), 0.95),
        at_most("correct flagged", float(np.mean([each.correct for each in found.values()])), 0.01),
        # There are enough of both kinds.
        at_least("directional textures", len(directional), 15),
        at_least("other textures", len(found) - len(directional), 15),
    ]
    return int(not all(are_met))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
