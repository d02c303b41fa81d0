"""Drift of a rig against its calibration: changes are found and named."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from classify.base.errors import CalibrationRejected, InputError
from classify.calibration.calibration import CalibratedLights, Calibration
from classify.calibration.drift import Drift, plate_drift
from classify.calibration.flat_field import PlateBlocks, fit_flat_field
from classify.images import ImageStack
from classify.lighting import Lighting
from tests.plates import Plate, ring_positions

RING = Lighting.ring(45.0)
RIG = Plate(ring_positions(10.0), specks=6, noise=0.005, ambient=0.02)  # five fields of view


def calibrated(rig: Plate) -> tuple[Calibration, float]:
    """The calibration from two placements of a sheet, and the brightness of that."""
    sheet = replace(rig, seed=11, tilt=(0.005, 0.003))
    blocks = PlateBlocks.of([sheet.stack, sheet.turned(2).stack], rig.full_scale)
    # Positions are as wrong as a plate gives them.
    errors = 1.0 + 0.02 * np.random.default_rng(1).standard_normal((4, 3))
    lighting = Lighting.near(rig.positions_px * errors)
    lights = CalibratedLights(lighting, "plate", np.ones(4), np.full(4, 0.02), 0.001, rig.lobe)
    brightness = float(np.exp(blocks.logs.mean())) / rig.full_scale
    return Calibration(flat_field=fit_flat_field(blocks).flat_field, lights=lights), brightness


@pytest.fixture(scope="module")
def calibration() -> tuple[Calibration, float]:
    return calibrated(RIG)


def drift_of(rig: Plate, calibration: tuple[Calibration, float], before: Plate = RIG) -> Drift:
    """The drift found on another sheet at the exposure of the calibration."""
    known, brightness = calibration
    # `Plate` exposes for its brightest pixel, a rig does not.
    light = rig.strengths.max() / before.strengths.max()
    exposed = replace(rig, brightest=rig.brightest * light)
    return plate_drift(exposed.stack, rig.full_scale, known, RING, brightness=brightness)


def with_level(rig: Plate, light: int, change: float) -> Plate:
    levels = np.array(rig.levels)
    levels[light] *= 1.0 + change
    return replace(rig, levels=tuple(levels))


def with_light_moved(rig: Plate, light: int, along_deg: float, down_deg: float) -> Plate:
    positions = np.array(rig.positions)
    radius = np.linalg.norm(positions[light])
    tilt = np.arctan2(positions[light, 1], positions[light, 0])
    slant = np.arccos(positions[light, 2] / radius)
    tilt, slant = tilt + np.radians(along_deg) / np.sin(slant), slant + np.radians(down_deg)
    across = np.sin(slant) * np.array([np.cos(tilt), np.sin(tilt)])
    positions[light] = radius * np.array([*across, np.cos(slant)])
    return replace(rig, positions=positions)


def with_camera_moved(rig: Plate, right: float, up: float, turn_deg: float) -> Plate:
    """Shift the camera by shares of the frame, and rotate it."""
    cosine, sine = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    moved = np.array(rig.positions) - 2.0 * np.array([right, up, 0.0])
    return replace(
        rig, positions=moved @ np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])
    )


def with_magnification(rig: Plate, factor: float) -> Plate:
    moved = factor * np.array(rig.positions)
    levels = factor**2 * np.array(rig.levels)  # the light on the sheet stays
    return replace(rig, positions=moved, levels=tuple(levels))


def kinds(drift: Drift) -> set[tuple[str, int | None]]:
    return {(cause.kind, cause.light) for cause in drift.causes}


@pytest.mark.parametrize(
    "changes",
    [
        {"seed": 3},
        {"seed": 4, "quarter_turns": 1},
        {"seed": 5, "tilt": (0.017, 0.0)},
        {"seed": 5, "tilt": (-0.012, 0.012)},
        {"seed": 6, "brightest": 0.8 * 0.88},
        {"seed": 7, "waviness": 0.01},
        {"seed": 8, "bits": 8},
        {"seed": 9, "noise": 0.02, "grain": 0.04},
    ],
)
def test_another_sheet_and_noise_are_no_drift(
    calibration: tuple[Calibration, float], changes: dict[str, Any]
) -> None:
    drift = drift_of(replace(RIG, **changes), calibration)
    assert (drift.status, drift.causes) == ("ok", ())
    assert drift.shows_moved_lights
    assert np.abs(drift.level_changes).max() < 0.03


@pytest.mark.parametrize(
    ("change", "status"),
    [(-0.07, "ok"), (0.07, "ok"), (-0.125, "warning"), (0.125, "warning"), (-0.18, "fault")],
)
def test_the_drift_of_one_led_is_measured(
    calibration: tuple[Calibration, float], change: float, status: str
) -> None:
    light = int(abs(1000 * change)) % 4
    rig = with_level(replace(RIG, seed=21, tilt=(0.005, -0.004)), light, change)
    drift = drift_of(rig, calibration)
    assert drift.status == status
    assert kinds(drift) == (set() if status == "ok" else {("led level", light)})
    assert drift.level_changes[light] == pytest.approx(change, abs=0.02)
    assert np.abs(np.delete(drift.level_changes, light)).max() < 0.03


@pytest.mark.parametrize(("along_deg", "down_deg"), [(5.0, 0.0), (0.0, 5.0), (-3.5, -3.5)])
def test_a_moved_light_is_named_with_its_angle(
    calibration: tuple[Calibration, float], along_deg: float, down_deg: float
) -> None:
    rig = with_light_moved(replace(RIG, seed=22), 2, along_deg, down_deg)
    (cause,) = drift_of(rig, calibration).causes
    assert (cause.kind, cause.light, cause.status) == ("light moved", 2, "fault")
    angle_deg = float(cause.finding.split("moved by ")[1].split()[0])
    assert angle_deg == pytest.approx(np.hypot(along_deg, down_deg), abs=0.6)


@pytest.mark.parametrize(
    ("rig", "kind", "words"),
    [
        (with_camera_moved(RIG, 0.12, 0.0, 0.0), "camera moved", "to the right"),
        (with_camera_moved(RIG, 0.0, 0.0, 4.0), "camera moved", " degrees anticlockwise"),
        (with_magnification(RIG, 1.25), "lens", "1.2"),
        (with_magnification(RIG, 0.8), "lens", "0.8"),
        (replace(RIG, vignetting=0.4), "lens", "corners"),
        (replace(RIG, brightest=0.4), "exposure", "0.5"),
        (replace(RIG, tilt=(0.06, 0.05)), "sheet tilted", "tilted by 4"),
    ],
)
def test_camera_lens_exposure_and_sheet_are_told_apart(
    calibration: tuple[Calibration, float], rig: Plate, kind: str, words: str
) -> None:
    drift = drift_of(replace(rig, seed=23), calibration)
    assert kinds(drift) == {(kind, None)}
    assert words in drift.causes[0].finding
    assert drift.causes[0].advice


@pytest.mark.parametrize("quarters", [1, 2, 3])
def test_leds_that_are_rotated_are_named(
    calibration: tuple[Calibration, float], quarters: int
) -> None:
    rig = with_camera_moved(replace(RIG, seed=23), 0.0, 0.0, 90.0 * quarters)
    (cause,) = drift_of(rig, calibration).causes
    assert (cause.kind, cause.status) == ("leds rotated", "fault")
    degrees = float(cause.finding.split("rotated by ")[1].split()[0])
    assert degrees == pytest.approx(180.0 - abs(180.0 - 90.0 * quarters), abs=1.0)


def test_two_changes_at_once_are_both_named(calibration: tuple[Calibration, float]) -> None:
    rig = with_light_moved(with_level(replace(RIG, seed=24), 0, -0.2), 3, 0.0, 6.0)
    assert kinds(drift_of(rig, calibration)) == {("led level", 0), ("light moved", 3)}


@pytest.mark.slow
def test_what_no_cause_explains_is_a_fault(calibration: tuple[Calibration, float]) -> None:
    """The shadow of a hand under one light."""
    stack = replace(RIG, seed=25).stack
    images = stack.images.copy()
    images[1, :, : images.shape[2] // 3] //= 2
    drift = plate_drift(ImageStack(images, stack.ambient), RIG.full_scale, calibration[0], RING)
    assert drift.status == "fault"
    assert ("unexplained", None) in kinds(drift)
    assert drift.brightness is None


def test_leds_that_point_down_are_recognised() -> None:
    rig = replace(RIG, aim="down", lobe=3.0)
    moved = with_light_moved(replace(rig, seed=26), 1, 0.0, 5.0)
    known, _ = calibrated(rig)
    (cause,) = plate_drift(moved.stack, rig.full_scale, known, RING).causes
    assert (cause.kind, cause.light) == ("light moved", 1)
    angle_deg = float(cause.finding.split("moved by ")[1].split()[0])
    assert angle_deg == pytest.approx(5.0, abs=0.6)


def test_moved_lights_are_found_without_calibrated_positions(
    calibration: tuple[Calibration, float],
) -> None:
    """The flat field contains them, also without lights or with directions alone."""
    rig = with_light_moved(replace(RIG, seed=29), 3, 0.0, 5.0)
    for lights in (None, distant_lights(calibration[0])):
        known = replace(calibration[0], lights=lights)
        drift = plate_drift(rig.stack, RIG.full_scale, known, RING)
        assert kinds(drift) == {("light moved", 3)}


def distant_lights(known: Calibration) -> CalibratedLights:
    assert known.lights is not None
    return replace(known.lights, lighting=RING, distance_errors=None)


def test_the_level_of_a_distant_led_is_compared_too() -> None:
    rig = replace(RIG, positions=ring_positions(1e3))
    known, _ = calibrated(rig)
    distant = replace(known, lights=distant_lights(known))
    drift = plate_drift(
        with_level(replace(rig, seed=27), 2, -0.2).stack, rig.full_scale, distant, RING
    )
    assert kinds(drift) == {("led level", 2)}
    assert not drift.shows_moved_lights


def test_a_calibration_without_plate_or_of_other_lights_is_refused(
    calibration: tuple[Calibration, float],
) -> None:
    stack = RIG.stack
    with pytest.raises(InputError, match="run ps4rig calibrate plate"):
        plate_drift(stack, RIG.full_scale, Calibration(), RING)
    three = ImageStack(stack.images[:3], stack.ambient)
    with pytest.raises(InputError, match=r"4 lights, .* 3"):
        plate_drift(three, RIG.full_scale, calibration[0], RING)


def test_images_of_anything_but_a_white_sheet_are_refused(
    calibration: tuple[Calibration, float],
) -> None:
    def refused(stack: ImageStack, words: str) -> None:
        with pytest.raises(CalibrationRejected, match=words):
            plate_drift(stack, RIG.full_scale, calibration[0], RING)

    stack = replace(RIG, seed=28).stack
    refused(ImageStack(np.full_like(stack.images, 4095), stack.ambient), "saturates 100")
    stripes = np.where(np.arange(192) // 48 % 2, 1.0, 0.6)
    refused(ImageStack((stack.images * stripes).astype(np.uint16), stack.ambient), "not a white")
