"""Frames of one scene at a ladder of exposures, on cameras that obey and others."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import pytest

from capture.acquisition.frame_series import (
    brightest_light,
    frame_series,
    frames_at,
    ladder_ms,
    require_free_running,
    restored_exposure,
)
from rig import CameraError, ConfigError, Rig, RigConfig, open_rig
from rig.simulation.sensor import SensorModel

FULL = 4095


@pytest.fixture
def sheet() -> Iterator[Rig]:
    camera = {"width_px": 96, "height_px": 96}
    placement = {"surface": "plate"}
    simulation = {"led_distance_px": 480.0, "led_levels": (0.8, 0.7, 1.0, 0.9)}
    config = RigConfig().with_changes(
        camera=camera, simulation=simulation | {"placement": placement}
    )
    with open_rig(config) as opened:
        yield opened


def test_frames_of_a_series_are_different_exposures_under_the_light(sheet: Rig) -> None:
    dark, lit = frame_series(sheet, None, 2), frame_series(sheet, 2, 3)
    assert (dark.shape, lit.shape) == ((2, 96, 96), (3, 96, 96))
    assert lit.mean() > 5.0 * dark.mean()
    assert not np.array_equal(lit[0], lit[1])


def test_the_brightest_light_is_found(sheet: Rig) -> None:
    assert brightest_light(sheet) == 2


def test_the_ladder_begins_where_half_of_the_frame_is_not_saturated(sheet: Rig) -> None:
    exposures_ms = ladder_ms(sheet, 2)
    top, below = frames_at(sheet, 2, exposures_ms[0], 1), frames_at(sheet, 2, exposures_ms[2], 1)
    assert (top >= FULL).mean() <= 0.5
    assert below.max() > 0.6 * FULL
    assert exposures_ms == sorted(exposures_ms, reverse=True)
    assert exposures_ms[-1] < exposures_ms[0] / 50.0


def test_frames_after_a_change_have_the_new_exposure(sheet: Rig) -> None:
    black = SensorModel(12).black_level_dn
    frame_series(sheet, 2, 1)
    long_ms, short_ms = (frames_at(sheet, 2, each, 1).mean() - black for each in (20.0, 5.0))
    assert long_ms / short_ms == pytest.approx(4.0, rel=0.01)


@pytest.mark.parametrize("error", [KeyboardInterrupt, CameraError])
def test_exposure_and_leds_are_as_before_also_after_an_error(
    sheet: Rig, error: type[BaseException], led_outputs: Callable[[Rig], list[float]]
) -> None:
    def interrupted() -> None:
        with restored_exposure(sheet):
            frames_at(sheet, 1, 3.0, 1)
            raise error

    with pytest.raises(error):
        interrupted()
    assert sheet.camera.info.exposure_s == pytest.approx(0.02)
    assert led_outputs(sheet) == [0.0, 0.0, 0.0, 0.0]


def test_a_fixed_exposure_is_refused(sheet: Rig) -> None:
    @dataclass
    class Fixed:
        exposure_range_ms = (20.0, 20.0)

    fixed = Rig(sheet.config, sheet.clock, sheet.lights, Fixed(), sheet.simulation)
    with pytest.raises(CameraError, match="one exposure only, 20 ms"):
        ladder_ms(fixed, 0)


def test_a_camera_that_waits_for_triggers_is_refused(sheet: Rig) -> None:
    require_free_running(sheet)
    config = sheet.config.with_changes(
        lights={"synchronisation": "trigger"}, camera={"readout_ms": 0.0}
    )
    triggered = Rig(config, sheet.clock, sheet.lights, sheet.camera, sheet.simulation)
    with pytest.raises(ConfigError, match="trigger"):
        require_free_running(triggered)
