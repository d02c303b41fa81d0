"""No set of a rig without faults is rejected, for any surface, slant and bit depth."""

from itertools import product
from pathlib import Path

import pytest

from capture import SetRejected, capture_set, import_images
from capture.acquisition.light_checks import check_set
from capture.sets.image_checks import CheckedImages
from capture.sets.light_list import load_light_list
from classify.calibration.calibration import Calibration
from rig import SYNTHETIC_30, Placement, RigConfig, open_rig
from rig.scene.material_folder import bundled_materials

BUTTERFLY = Path(__file__).parents[2] / "data" / "butterfly_crop"
SURFACES = (*SYNTHETIC_30, *bundled_materials())
SLANTS_DEG = (30.0, 45.0, 60.0, 75.0)
BITS = (8, 10, 12, 16)
ROTATIONS_DEG = (0.0, 25.0)


def rejections(
    surfaces: tuple[str, ...], slant_deg: float, bits: int
) -> tuple[list[str], int, int]:
    """The causes of rejection, the number of sets, and how many needed a retake."""
    config = RigConfig().with_changes(
        camera={"width_px": 64, "height_px": 64, "bits": bits}, lights={"slant_deg": slant_deg}
    )
    rejected, sets, retakes = [], 0, 0
    with open_rig(config) as rig:
        for surface in surfaces:
            for rotate_deg in ROTATIONS_DEG:
                rig.simulation.place(Placement(surface=surface, rotate_deg=rotate_deg))
                rig.clock.sleep_s(0.2)
                sets += 1
                try:
                    metadata = capture_set(rig).metadata
                except SetRejected as error:
                    rejected.append(f"{surface}, slant {slant_deg}, {bits} bit: {error}")
                    continue
                rejected += [
                    f"{surface}, {slant_deg}, {bits} bit: {c}" for c in metadata.failed_attempts
                ]
                retakes += metadata.checks.retaken
    return rejected, sets, retakes


def test_some_clean_sets() -> None:
    rejected, _, retakes = rejections(("rock", "cobbles", "Leather037"), 45.0, 8)
    assert rejected == []
    assert retakes == 2  # of the leather: flat and dark


@pytest.mark.slow
def test_a_thousand_clean_sets() -> None:
    all_rejected, total = [], 0
    print()
    # The cache of the simulated rig holds this many surfaces, so that each is made once.
    for first in range(0, len(SURFACES), 8):
        surfaces = SURFACES[first : first + 8]
        print(*surfaces)
        for slant_deg, bits in product(SLANTS_DEG, BITS):
            rejected, sets, retakes = rejections(surfaces, slant_deg, bits)
            print(f"slant {slant_deg:g}, {bits} bit: {sets} sets, {retakes} retakes")
            all_rejected += rejected
            total += sets
    print(f"{total} clean sets, {len(all_rejected)} failed attempts")
    assert total >= 1000
    assert all_rejected == []


@pytest.mark.parametrize("chosen", [(6, 0, 2, 4), (7, 1, 3, 5)])
def test_photographs_under_near_and_uneven_lights_pass(chosen: tuple[int, ...]) -> None:
    files = [BUTTERFLY / f"image{number}.png" for number in chosen]
    lighting = load_light_list(BUTTERFLY / "lights.json").lighting_for(files)
    photographs = import_images(files, lighting, ambient=BUTTERFLY / "ambient.png")
    ambient = photographs.ambient
    assert ambient is not None
    names, full_scale = list(map(str, chosen)), photographs.metadata.full_scale
    images = CheckedImages(photographs.images, ambient, ambient, lighting, names, full_scale, None)
    # Near lights differ over the frame, so that these images cannot confirm one another.
    checks = check_set(images, Calibration(), lambda: photographs.images)
    assert checks.ambient_change == 0.0
    assert checks.undecided
    assert checks.retaken
    assert checks.light_levels is None
