"""Lights from sets of a sphere, corrected by the other parts of a calibration."""

import numpy as np
import pytest

from capture import CapturedSet, capture_set
from capture.calibration.ps4cal import CalibrationFile
from capture.calibration.replacement import reason_to_keep
from capture.procedures.plate_parts import plate_parts
from capture.procedures.target_parts import images_of_sets, sphere_parts
from classify.calibration.sphere_outline import find_outline
from classify.lighting import angles_between_deg
from classify.lights.flat_field import FlatField
from rig import Placement, RigConfig, open_rig


@pytest.mark.slow
def test_vignetting_of_the_flat_field_does_not_turn_the_lights_on_a_matt_sphere() -> None:
    config = RigConfig().with_changes(
        camera={"width_px": 192, "height_px": 160},
        simulation={"vignetting_percent": 30.0, "led_levels": (1.0, 0.9, 1.1, 1.0)},
    )
    with open_rig(config) as rig:
        assert rig.simulation is not None

        def captured(placement: Placement) -> CapturedSet:
            rig.simulation.place(placement)  # type: ignore[union-attr]
            return capture_set(rig, is_target=True)

        sheet = [captured(Placement(surface="plate", rotate_deg=turn)) for turn in (0.0, 180.0)]
        ball = captured(Placement(surface="matte_sphere", shift_px=(10.0, 5.0)))
        true = rig.lighting.directions
    plain, known = CalibrationFile(), CalibrationFile()
    for part in plate_parts(sheet, plain.calibration, None, ("captured",)):
        known = known.with_part(part.name, part.part, part.record)
    errors_deg = []
    for file in (plain, known):
        pictures = images_of_sets([ball], file)
        (lights,) = sphere_parts(pictures, "matte", file, ball.setting, ("captured",))
        errors_deg.append(angles_between_deg(lights.part.lighting.directions, true).max())
    assert errors_deg[1] < 0.5 < errors_deg[0]


@pytest.mark.slow
@pytest.mark.parametrize("diameter_px", [102.4, 153.6])
def test_the_card_that_a_mirror_sphere_reflects_is_not_taken_for_its_outline(
    diameter_px: float,
) -> None:
    config = RigConfig().with_changes(
        camera={"width_px": 512, "height_px": 512},
        simulation={
            "mm_per_px": 1.0,
            "placement": {"surface": "mirror_sphere", "size_mm": diameter_px},
        },
    )
    with open_rig(config) as rig:
        captured = capture_set(rig, is_target=True)
    circle = find_outline(captured.images).circle
    assert 2.0 * circle.radius == pytest.approx(diameter_px, rel=0.01)
    assert (circle.column, circle.row) == pytest.approx((255.5, 255.5), abs=0.3)


def test_a_sphere_that_gives_directions_does_not_replace_positions(
    near_config: RigConfig, near_calibration: CalibrationFile
) -> None:
    sphere = Placement(surface="mirror_sphere")
    config = near_config.with_changes(simulation={"placement": sphere.model_dump()})
    with open_rig(config) as rig:
        ball = capture_set(rig, is_target=True)
    lacking = "it has positions, which the new one lacks"
    for file, reason in ((CalibrationFile(), None), (near_calibration, lacking)):
        pictures = images_of_sets([ball], file)
        (lights,) = sphere_parts(pictures, "mirror", file, ball.setting, ("captured",))
        assert lights.part.lighting.positions_px is None
        assert reason_to_keep(file, lights) == reason


def test_the_shared_part_of_a_flat_field_is_the_geometric_mean_over_lights() -> None:
    rng = np.random.default_rng(0)
    flat_field = FlatField(0.1 * rng.standard_normal((4, 3, 3)), np.tile([-9.0, 9.0], (4, 1)))
    place = np.arange(20), np.arange(30), (20, 30)
    mean = np.exp(np.log(flat_field.strengths(*place)).mean(axis=0))
    for shared in flat_field.shared.strengths(*place):
        np.testing.assert_allclose(shared, mean)
