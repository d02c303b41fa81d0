"""`rig latency` on simulated cameras with known timing, and frames selected by its result."""

import math
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from rig import CameraError, ConfigError, Frame, Rig, RigConfig, open_rig
from rig.latency import CameraLatency, measure_latency, without_timing
from rig.step_fit import lit_share

SIZE = {"width_px": 32, "height_px": 48}


@dataclass(frozen=True)
class Truth:
    """The true timing of a simulated camera."""

    rate_hz: float = 30.0
    exposure_ms: float = 20.0
    lag_ms: float = 24.0
    jitter_ms: float = 0.0
    readout_ms: float = 0.0
    rise_ms: float = 0.5
    fall_ms: float = 0.3
    clock: str = "virtual"

    @property
    def config(self) -> RigConfig:
        return RigConfig().with_changes(
            camera={**SIZE, "frame_rate_hz": self.rate_hz, "exposure_ms": self.exposure_ms},
            simulation={
                "clock": self.clock,
                "stamp_lag_ms": self.lag_ms,
                "stamp_jitter_ms": self.jitter_ms,
                "readout_ms": self.readout_ms,
                "led_rise_ms": self.rise_ms,
                "led_fall_ms": self.fall_ms,
            },
        )

    @property
    def offset_ms(self) -> float:
        """From the earliest possible stamp to the end of the last row's exposure."""
        return self.exposure_ms + self.readout_ms - self.lag_ms


def measured(truth: Truth, steps: int = 40) -> CameraLatency:
    with open_rig(without_timing(truth.config)) as rig:
        return measure_latency(rig, steps=steps)


def calibrated(truth: Truth, latency: CameraLatency) -> RigConfig:
    settle_ms = max(truth.config.lights.settle_ms, latency.settle_ms)
    return truth.config.with_changes(camera=dict(latency.camera), lights={"settle_ms": settle_ms})


def check_stored_values(truth: Truth, latency: CameraLatency) -> None:
    keys = ("timestamp_offset_ms", "timestamp_uncertainty_ms", "readout_ms")
    offset_ms, uncertainty_ms, readout_ms = (float(latency.camera[key]) for key in keys)
    earliest_ms, latest_ms = truth.offset_ms - truth.jitter_ms, truth.offset_ms
    # Never later than the truth for any jitter, and earlier by no more than the uncertainty.
    # 0.02 ms is twice the rounding of the keys.
    assert offset_ms - uncertainty_ms <= earliest_ms + 0.02
    assert offset_ms + uncertainty_ms >= latest_ms - 0.02
    error_ms = max(5.0 * 1e3 * latency.fit.readout_error_s, 0.1)
    assert readout_ms == pytest.approx(truth.readout_ms, abs=error_ms)
    rise_ms, fall_ms = 1e3 * latency.fit.rise_s, 1e3 * latency.fit.fall_s
    # Jitter looks like slow light: by up to twice as much with few steps of a short exposure, see
    # the example of the test of random cameras.
    within_ms = 0.3 + 2.0 * truth.jitter_ms
    assert rise_ms == pytest.approx(truth.rise_ms, abs=within_ms, rel=0.3)
    assert fall_ms == pytest.approx(truth.fall_ms, abs=within_ms, rel=0.3)


def light_in(rig: Rig, frame: Frame, readout_ms: float) -> np.ndarray:
    """(4, 2) true share of each LED's light in the first and the last row."""
    assert rig.simulation is not None
    info = rig.camera.info
    begun_s = rig.simulation.camera.exposures.start_s(frame.sequence)
    rows = (begun_s, begun_s + readout_ms / 1e3)
    return np.array(
        [
            [
                rig.simulation.board.output_integral_s(led, row_s, row_s + info.exposure_s)
                / info.exposure_s
                for row_s in rows
            ]
            for led in range(4)
        ]
    )


def check_no_frame_is_stale_or_mixed(truth: Truth, config: RigConfig, switches: int) -> list[int]:
    """Take the first fresh frame after each of many switches; return the frames needed for each."""
    rng = np.random.default_rng(3)
    frames_per_switch = []
    with open_rig(config) as rig:
        period_s = rig.camera.info.frame_period_s
        for count in range(switches):
            led = None if count % 5 == 4 else count % 5
            rig.clock.sleep_s(rng.uniform(0.0, period_s))
            switch = rig.lights.off() if led is None else rig.lights.select(led)
            not_before_s = switch.acknowledged_s + config.lights.settle_ms / 1e3
            received = 1
            while (frame := rig.camera.read(1.0)).exposure_start_s < not_before_s:
                received += 1
            light = light_in(rig, frame, truth.readout_ms)
            expected = np.zeros((4, 2))
            if led is not None:
                expected[led] = 1.0
            # Settled means within a thousandth at the start of the exposure.
            np.testing.assert_allclose(light, expected, atol=1.1e-3)
            frames_per_switch.append(received)
    return frames_per_switch


CAMERAS = [
    Truth(lag_ms=0.0, readout_ms=30.0, rise_ms=4.0, fall_ms=2.0),
    Truth(lag_ms=24.0, jitter_ms=3.0, readout_ms=8.0),
]


@pytest.mark.parametrize("truth", CAMERAS, ids=str)
def test_the_measured_timing_is_true_and_lets_no_stale_frame_pass(truth: Truth) -> None:
    latency = measured(truth)
    check_stored_values(truth, latency)
    check_no_frame_is_stale_or_mixed(truth, calibrated(truth, latency), 25)


@pytest.mark.slow
@settings(max_examples=25, deadline=None)
@example(Truth(60.0, 3.0, lag_ms=16.0, jitter_ms=0.5, readout_ms=0.0, rise_ms=0.25, fall_ms=0.25))
@given(
    truth=st.builds(
        Truth,
        rate_hz=st.sampled_from([10.0, 30.0, 60.0]),
        exposure_ms=st.floats(3.0, 16.0),
        lag_ms=st.floats(-5.0, 60.0),
        jitter_ms=st.floats(0.0, 1.0),
        readout_ms=st.floats(0.0, 16.0),
        rise_ms=st.floats(0.05, 5.0),
        fall_ms=st.floats(0.05, 5.0),
    )
)
def test_the_timing_of_random_cameras_is_measured(truth: Truth) -> None:
    latency = measured(truth)
    check_stored_values(truth, latency)
    check_no_frame_is_stale_or_mixed(truth, calibrated(truth, latency), 40)


@pytest.mark.slow
def test_on_the_real_clock() -> None:
    truth = Truth(60.0, 8.0, lag_ms=20.0, jitter_ms=1.0, readout_ms=8.0, clock="real")
    latency = measured(truth, steps=30)
    check_stored_values(truth, latency)
    check_no_frame_is_stale_or_mixed(truth, calibrated(truth, latency), 40)


def test_a_measured_camera_needs_fewer_frames_for_each_switch() -> None:
    truth = Truth()
    unknown = check_no_frame_is_stale_or_mixed(truth, without_timing(truth.config), 25)
    known = check_no_frame_is_stale_or_mixed(truth, calibrated(truth, measured(truth)), 25)
    assert np.mean(known) <= np.mean(unknown) - 0.8


def test_first_and_last_row_change_one_readout_apart() -> None:
    latency = measured(Truth(readout_ms=15.0))
    # The last row is exposed 15 ms later, so more of its exposure follows the switch.
    difference_ms = latency.first_row.typical_ms - latency.last_row.typical_ms
    assert difference_ms == pytest.approx(15.0, abs=4.0)
    assert latency.first_row.most_ms <= 2 * 1e3 / 30 + 20.0 + 15.0 + 4.0
    assert latency.first_row.most_frames <= 3


def test_a_triggered_rig_is_measured_by_software() -> None:
    truth = Truth()
    config = truth.config.with_changes(lights={"synchronisation": "trigger"})
    with open_rig(without_timing(config)) as rig:
        check_stored_values(truth, measure_latency(rig))


UNSTEADY = {"faults": {"leds": [{"kind": "unsteady", "led": 0}]}}


@pytest.mark.parametrize(
    ("changes", "level", "message"),
    [
        ({}, 0, "makes no difference"),
        ({"camera": {"exposure_ms": 33.0}}, 100, r"saturated.*shorten"),
        ({"simulation": UNSTEADY}, 100, r"not follow LED 0: .* limit 8%"),
    ],
    ids=["LED out of sight", "saturated", "other light"],
)
def test_frames_that_do_not_show_the_led_are_refused(
    changes: dict[str, dict[str, object]], level: int, message: str
) -> None:
    config = without_timing(RigConfig().with_changes(camera=SIZE).with_changes(**changes))
    with open_rig(config) as rig:
        rig.lights.set_level(0, level)
        with pytest.raises(CameraError, match=message):
            measure_latency(rig, steps=10)


def test_a_camera_without_time_stamps_is_refused() -> None:
    config = RigConfig.model_validate(
        {"lights": {"port": "/dev/ttyACM0"}, "camera": {"kind": "opencv", "device": 0}}
    )
    with pytest.raises(ConfigError, match="no time stamps"):
        without_timing(config)


@given(left_ms=st.floats(-10.0, 60.0), exposure_ms=st.floats(1.0, 30.0), tau=st.floats(0.01, 5.0))
def test_the_share_of_a_step_is_the_integral_over_the_exposure(
    left_ms: float, exposure_ms: float, tau: float
) -> None:
    # Time since the step at 2000 points of the exposure.
    since = left_ms - exposure_ms * (np.arange(2000) + 0.5) / 2000
    mean = float(np.where(since > 0, -np.expm1(-np.maximum(since, 0.0) / tau), 0.0).mean())
    share = float(lit_share(np.array([left_ms]), exposure_ms, tau)[0])
    assert math.isclose(share, mean, abs_tol=2e-3)
