"""Rates at which wrong photographs are refused, and true ones.

    python -m tests.evidence.photograph_rates [DIR] [--quick]

A table for every folder of DIR with photographs and their `lights.json`; an intensity may have the
name ``relative_intensity_estimated`` there. Without DIR they are those of `tests/data`. --quick
takes every fourth ring of four lights.
"""

import argparse
import json
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import permutations, product
from pathlib import Path

import cv2
import numpy as np

from capture.base.errors import ImportCause
from capture.sets.image_checks import CheckedImages, check_photographs
from classify import Lighting
from classify.calibration.calibration import Calibration
from classify.lights.shading import shading_of, shading_order
from rig.image_metadata import linear_from_srgb

from .limits import at_least, at_most

DATA = Path(__file__).parents[1] / "data"
# A light may stand so far from the ring, which has any slant and any tilt of its first light.
OFF_RING_DEG = 20.0
EXCHANGED = {
    "two across": ((2, 1, 0, 3), (0, 3, 2, 1)),
    "two neighbours": ((1, 0, 2, 3), (0, 2, 1, 3), (0, 1, 3, 2), (3, 1, 2, 0)),
    "turned by 180": ((2, 3, 0, 1),),
}
EXCHANGED["another order"] = tuple(
    order
    for order in permutations(range(4))
    if order not in ((0, 1, 2, 3), *(each for orders in EXCHANGED.values() for each in orders))
)


def photographs(folder: Path) -> CheckedImages:
    """All photographs of a folder; a JPEG is taken for sRGB."""
    entries = json.loads((folder / "lights.json").read_text())["images"]
    read = [cv2.imread(str(folder / entry["file"]), cv2.IMREAD_GRAYSCALE) for entry in entries]
    images, full_scale = np.stack(read).astype(np.uint16), 255
    if entries[0]["file"].endswith(".jpg"):
        linear = linear_from_srgb(images.astype(np.float32) / 255.0)
        images, full_scale = np.rint(65_535.0 * linear).astype(np.uint16), 65_535
    ambient = np.zeros_like(images[0])
    if (folder / "ambient.png").exists():
        dark = cv2.imread(str(folder / "ambient.png"), cv2.IMREAD_GRAYSCALE)
        ambient = dark.astype(np.uint16)
    keys = ("intensity", "relative_intensity_estimated")
    lighting = Lighting(
        np.array([entry["direction"] for entry in entries]),
        np.array([next((e[key] for key in keys if key in e), 1.0) for e in entries]),
    )
    names = [entry["file"] for entry in entries]
    return CheckedImages(images, ambient, None, lighting, names, full_scale, None)


def rings(lighting: Lighting) -> Iterator[list[int]]:
    """Four lights near each ring, each four once."""
    found = set()
    for tilt, slant in product(range(0, 90, 15), range(10, 65, 5)):
        ring = Lighting.ring(slant, [tilt + 90.0 * k for k in range(4)])
        cosines = np.clip(ring.directions @ lighting.directions.T, -1.0, 1.0)
        picked = cosines.argmax(axis=1)
        off_deg = np.degrees(np.arccos(cosines.max(axis=1))).max()
        if len(set(picked)) == 4 and off_deg <= OFF_RING_DEG and frozenset(picked) not in found:
            found.add(frozenset(picked))
            yield picked.tolist()


def part(images: CheckedImages, of_images: list[int], of_lights: list[int]) -> CheckedImages:
    lights = images.lighting
    lighting = Lighting(lights.directions[of_lights], lights.intensities[of_lights])
    names = [f"{place}: {images.names[k]}" for place, k in enumerate(of_images)]
    return CheckedImages(
        images.images[of_images], images.ambient, None, lighting, names, images.full_scale, None
    )


def refused(images: CheckedImages) -> set[ImportCause]:
    return {
        each.cause for each in check_photographs(images, None, Calibration())[0] if each.refutes
    }


def _are_met(folder: Path, others: CheckedImages, step: int) -> bool:
    images = photographs(folder)
    everything = list(range(len(images.names)))
    wrongly = int(refused(images) != set())
    counts: Counter[str] = Counter()
    tried: Counter[str] = Counter()
    for number, picked in list(enumerate(rings(images.lighting)))[::step]:
        true = part(images, picked, picked)
        wrongly += refused(true) != set()
        shading = shading_of(true.images, true.ambient, true.full_scale)
        for name, orders in EXCHANGED.items():
            for order in orders:
                tried[name] += 1
                lighting = part(images, picked, [picked[k] for k in order]).lighting
                counts[name] += shading_order(shading, lighting).verdict == "refuted"
        place = number % 4
        twice = list(picked)
        twice[place] = picked[place - 1]
        tried["one twice"] += 1
        counts["one twice"] += ImportCause.EQUAL_IMAGES in refused(part(images, twice, picked))
        own = images.images[picked[place]]
        other = others.images[number % len(others.images)]
        scene = cv2.resize(other, own.shape[::-1]) * (images.full_scale / others.full_scale)
        for name, image in (
            ("another scene", scene),
            ("upside down", own[::-1, ::-1]),
            ("moved by 10 px", np.roll(own, (10, 10), (0, 1))),
        ):
            wrong = part(images, picked, picked)
            wrong.images[place] = image
            tried[name] += 1
            counts[name] += ImportCause.RESIDUAL in refused(wrong)
    shading = shading_of(images.images, images.ambient, images.full_scale)
    rng = np.random.default_rng(1)
    for _ in range(20):
        order = list(everything)
        first, second = rng.choice(everything, 2, replace=False)
        order[first], order[second] = order[second], order[first]
        tried["two of all"] += 1
        lighting = part(images, everything, order).lighting
        counts["two of all"] += shading_order(shading, lighting).verdict == "refuted"
    for count in (4, 5, 6, 8) * 5:
        picked = sorted(rng.choice(everything, min(count, len(everything)), replace=False).tolist())
        wrongly += ImportCause.LIGHT_ORDER in refused(part(images, picked, picked))
    print(f"\n{folder.name}: {tried['one twice']} picks; refused with")
    for name, of in tried.items():
        print(f"  {name:16}{counts[name] / of:8.1%} of {of}")
    are_met = [
        at_most("refused with its own lights", wrongly, 0),
        at_least("one photograph twice", counts["one twice"], tried["one twice"]),
        at_least("another scene", counts["another scene"], tried["another scene"]),
    ]
    return all(are_met)


def main(arguments: Sequence[str]) -> int:
    """Print the tables; return 1 if true photographs are refused or plainly wrong ones are not."""
    parser = argparse.ArgumentParser(prog="photograph_rates")
    parser.add_argument("folder", nargs="?", type=Path, default=DATA)
    parser.add_argument("--quick", action="store_true")
    given = parser.parse_args(arguments)
    folders = sorted(path.parent for path in given.folder.glob("*/lights.json"))
    are_met = [
        _are_met(folder, photographs(folders[number - 1]), 4 if given.quick else 1)
        for number, folder in enumerate(folders)
    ]
    return int(not all(are_met))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
