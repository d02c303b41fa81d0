"""No set of a rig without faults is refused, whatever the surface, the slant and the camera."""

from pathlib import Path

import pytest

from capture import SetRejected, capture_set, import_images
from capture.acquisition.light_checks import Pictures, check_ambient, check_lights
from capture.sets.light_list import load_light_list
from rig import SYNTHETIC_30, Placement, RigConfig, open_rig
from rig.scene.material_folder import bundled_materials

BUTTERFLY = Path(__file__).parents[2] / "data" / "butterfly_crop"
SURFACES = (*SYNTHETIC_30, *bundled_materials())
SLANTS_DEG = (30.0, 45.0, 60.0, 75.0)
BITS = (8, 10, 12, 16)
ROTATIONS_DEG = (0.0, 25.0)


def refusals(surfaces: tuple[str, ...], slant_deg: float, bits: int) -> tuple[list[str], int, int]:
    """What was refused and why, and how many sets there were and took a second look."""
    config = RigConfig().with_changes(
        camera={"width_px": 64, "height_px": 64, "bits": bits}, lights={"slant_deg": slant_deg}
    )
    refused, sets, second_looks = [], 0, 0
    with open_rig(config) as rig:
        assert rig.simulation is not None
        for surface in surfaces:
            for rotate_deg in ROTATIONS_DEG:
                rig.simulation.place(Placement(surface=surface, rotate_deg=rotate_deg))
                rig.clock.sleep_s(0.2)
                sets += 1
                try:
                    metadata = capture_set(rig).metadata
                except SetRejected as error:
                    refused.append(f"{surface}, slant {slant_deg}, {bits} bit: {error}")
                    continue
                refused += [
                    f"{surface}, {slant_deg}, {bits} bit: {c}" for c in metadata.failed_attempts
                ]
                assert metadata.checks is not None
                second_looks += metadata.checks.retaken
    return refused, sets, second_looks


def test_some_clean_sets() -> None:
    refused, _, second_looks = refusals(("rock", "cobbles", "Leather037"), 45.0, 8)
    assert refused == []
    assert second_looks == 2  # of the leather: flat and dark


@pytest.mark.slow
def test_a_thousand_clean_sets() -> None:
    all_refused, total = [], 0
    print()
    for slant_deg in SLANTS_DEG:
        for bits in BITS:
            refused, sets, second_looks = refusals(SURFACES, slant_deg, bits)
            print(f"slant {slant_deg:g}, {bits} bit: {sets} sets, {second_looks} second looks")
            all_refused += refused
            total += sets
    print(f"{total} clean sets, {len(all_refused)} refused or begun again")
    assert total >= 1000
    assert all_refused == []


@pytest.mark.parametrize("chosen", [(6, 0, 2, 4), (7, 1, 3, 5)])
def test_photographs_under_near_and_uneven_lights_pass(chosen: tuple[int, ...]) -> None:
    files = [BUTTERFLY / f"image{number}.png" for number in chosen]
    lighting = load_light_list(BUTTERFLY / "lights.json").lighting_for(files)
    photographs = import_images(files, lighting, ambient=BUTTERFLY / "ambient.png")
    images, ambient = photographs.images, photographs.ambient
    assert ambient is not None
    pictures = Pictures(images, ambient, ambient, photographs.metadata.full_scale, None)
    change = check_ambient(pictures)
    names = [f"light {number}" for number in chosen]
    checks = check_lights(pictures, lighting, names, change, lambda: images)
    # Near lights are not the same in all parts of the frame: these pictures cannot vouch for them.
    assert checks.retaken
    assert checks.light_levels is None
