"""Calibration by images of a white matt sheet, and causes of refusals."""

from dataclasses import replace

import numpy as np
import pytest

from classify import Lighting
from classify.base.errors import CalibrationRejected, InputError
from classify.calibration.plate import MeasuredPlate, measure_plate
from classify.images import ImageStack
from tests.plates import Plate, ring_positions

RING = Lighting.ring(45.0)
SHEET = Plate(ring_positions(8.0), brightest=0.6, specks=20)


def measured(
    plate: Plate, turns: tuple[int, ...] = (0, 2), lighting: Lighting = RING
) -> MeasuredPlate:
    return measure_plate([plate.turned(each).stack for each in turns], plate.full_scale, lighting)


def test_a_sheet_gives_flat_field_and_positions() -> None:
    found = measured(replace(SHEET, tilt=(0.02, 0.0)))
    assert found.lights is not None
    assert found.lights.source == "plate"
    np.testing.assert_allclose(
        found.lights.lighting.positions_px, SHEET.positions_px, atol=0.02 * 8.0 * 96.0
    )
    np.testing.assert_allclose(found.tilts_deg, np.degrees(0.02), atol=0.1)
    assert found.flat_field.unused < 0.1


def test_one_placement_is_less_certain_than_two() -> None:
    once, twice = (measured(SHEET, turns).lights for turns in ((0,), (0, 2)))
    assert once is not None
    assert twice is not None
    assert once.direction_errors_deg.min() > 1.0 > twice.direction_errors_deg.max()


def test_distant_lights_keep_their_directions_and_say_why() -> None:
    found = measured(replace(SHEET, positions=ring_positions(300.0)))
    assert found.lights is None
    assert found.no_lights_because is not None
    assert "too far away" in found.no_lights_because


@pytest.mark.parametrize(
    ("plate", "cause"),
    [
        (
            replace(SHEET, brightest=1.3),
            r"light 2 saturates \d+\.\d% .*camera.exposure_ms",
        ),
        (replace(SHEET, brightest=0.06), r"too dark: .* \d\.\d% .* light \d"),
        (replace(SHEET, tilt=(0.12, 0.0)), r"tilted by [67]\.\d degrees"),
        (replace(SHEET, waviness=0.05, grain=0.3, brightest=0.3), "not a white"),
        (
            Plate(ring_positions(4.0, 25.0), brightest=0.5, gloss=0.3, shine=1000.0),
            r"shiny: .* \d\.\d% .* lights 0, 1, 2, 3",
        ),
    ],
    ids=["saturated", "dark", "tilted", "uneven", "shiny"],
)
def test_a_bad_sheet_is_refused(plate: Plate, cause: str) -> None:
    slant_deg = 25.0 if plate.gloss else 45.0
    with pytest.raises(CalibrationRejected, match=cause):
        measured(plate, lighting=Lighting.ring(slant_deg))


@pytest.mark.parametrize("distance", [8.0, 300.0])
def test_a_tilt_that_does_not_turn_with_the_sheet_is_refused(distance: float) -> None:
    plate = Plate(ring_positions(distance), brightest=0.4, tilt=(0.3, 0.0), levels=(1.0,) * 4)
    with pytest.raises(CalibrationRejected, match=r"tilted by about 1\d degrees"):
        measure_plate([plate.stack, replace(plate, seed=1).stack], plate.full_scale, RING)


def test_light_unlike_that_of_leds_gives_no_positions() -> None:
    x, _ = SHEET.coordinates()
    stack = SHEET.stack
    bent = stack.images * np.exp(0.06 * np.sin(3.0 * x))[None] ** [[[1]], [[-1]], [[1]], [[-1]]]
    found = measure_plate([ImageStack(bent.astype(np.uint16), stack.ambient)], 4095.0, RING)
    assert found.lights is None
    assert found.no_lights_because is not None
    assert "sheet is shiny" in found.no_lights_because


def test_a_surface_with_relief_is_refused_as_a_sheet() -> None:
    rng = np.random.default_rng(4)
    p, q = 0.3 * rng.standard_normal((2, 192, 192))
    x, y, z = RING.directions.T[..., None, None]
    values = 2500.0 * np.maximum(z - x * p - y * q, 0.0) / np.sqrt(1.0 + p * p + q * q)
    stack = ImageStack(np.minimum(values, 4000.0).astype(np.uint16), None)
    with pytest.raises(CalibrationRejected, match=r"relief of rms slope 0\.\d+"):
        measure_plate([stack], 4095.0, RING)


def test_the_sheet_must_fill_the_frame_or_the_mask() -> None:
    stack = SHEET.stack
    stack.images[:, :, 20:] = 0
    with pytest.raises(CalibrationRejected, match=r"only \d+% of the frame"):
        measure_plate([stack], SHEET.full_scale, RING)


def test_two_lights_are_too_few() -> None:
    stack = ImageStack(SHEET.stack.images[:2], None)
    with pytest.raises(InputError, match=r"2 lights; .*three or more"):
        measure_plate([stack], SHEET.full_scale, Lighting(RING.directions[:2]))


def test_placements_must_be_alike() -> None:
    other = replace(SHEET, shape=(96, 96))
    with pytest.raises(InputError, match="size or in lights"):
        measure_plate([SHEET.stack, other.stack], SHEET.full_scale, RING)


def test_the_same_light_images_are_no_second_placement() -> None:
    with pytest.raises(InputError, match=r"placements 1 and 2 .*rotate"):
        measured(SHEET, (0, 0))


@pytest.mark.parametrize(("distance", "bits"), [(2.0, 8), (8.0, 12), (300.0, 12)])
def test_a_sheet_that_was_not_rotated_counts_as_one_placement(distance: float, bits: int) -> None:
    plate = replace(SHEET, positions=ring_positions(distance), grain=0.01, bits=bits, specks=0)
    clean = replace(plate, noise=0.0).stack
    again = []
    for seed in range(2):
        noise = plate.noise * np.sqrt(clean.images * plate.full_scale)
        noise *= np.random.default_rng(seed).standard_normal(clean.images.shape)
        images = np.rint(np.clip(clean.images + noise, 0.0, plate.full_scale))
        again.append(ImageStack(images.astype(clean.images.dtype), clean.ambient))
    found = measure_plate(again, plate.full_scale, RING)
    assert not found.is_moved
    assert found.lights is None or found.lights.direction_errors_deg.min() > 1.0
    for turn in (1, 2):
        assert measured(plate, (0, turn)).is_moved
    moved = ImageStack(np.roll(clean.images, 3, axis=2), clean.ambient)
    assert measure_plate([clean, moved], plate.full_scale, RING).is_moved


def test_one_picture_for_all_lights_gives_no_positions() -> None:
    one = SHEET.stack
    same = ImageStack(np.repeat(one.images[:1], 4, axis=0), one.ambient)
    assert measure_plate([same], SHEET.full_scale, RING).lights is None
