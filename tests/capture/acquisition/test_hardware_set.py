"""Hardware-synchronised sets have the images of a set by software, or are rejected.

The simulated board tells how long each LED was on during each frame.
"""

import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import count

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from capture import CapturedSet, SetRejected, capture_set
from rig import (
    CameraError,
    ConfigError,
    Frame,
    LightControllerError,
    Rig,
    RigConfig,
    open_rig,
)
from tests.changed_frames import with_frames

SMALL = {"width_px": 16, "height_px": 16}
# Share of an exposure. A light that changes at the wrong time is wrong for far more.
WRONG_LIGHT = 0.01


def config(synchronisation: str = "strobe", **changes: dict[str, object]) -> RigConfig:
    lights = {"synchronisation": synchronisation, **changes.pop("lights", {})}
    camera = {**SMALL, **changes.pop("camera", {})}
    return RigConfig().with_changes(lights=lights, camera=camera, **changes)


@pytest.fixture(params=["strobe", "trigger"])
def rig(request: pytest.FixtureRequest) -> Iterator[Rig]:
    with open_rig(config(request.param)) as opened:
        yield opened


def wrong_light(rig: Rig, captured: CapturedSet) -> float:
    """Largest share of an exposure with a wrong LED on, or the right one off."""
    worst = 0.0
    for image in captured.metadata.images:
        for frame in image.frames:
            exposure_s = frame.exposure_end_s - frame.exposure_start_s
            for led in range(4):
                lit_s = rig.simulation.board.output_integral_s(
                    led, frame.exposure_start_s, frame.exposure_end_s
                )
                wanted_s = exposure_s if led == image.light else 0.0
                worst = max(worst, abs(lit_s - wanted_s) / exposure_s)
    return worst


@pytest.mark.parametrize("synchronisation", ["strobe", "trigger"])
@pytest.mark.parametrize(("frame_rate_hz", "exposure_ms"), [(30, 20), (60, 8)])
def test_the_images_equal_those_of_a_set_by_software(synchronisation, frame_rate_hz, exposure_ms):
    camera = {"frame_rate_hz": frame_rate_hz, "exposure_ms": exposure_ms}
    camera |= {"width_px": 64, "height_px": 64}
    sets = []
    for mode in ("software", synchronisation):
        with open_rig(config(mode, camera=camera)) as rig:
            sets.append(capture_set(rig))
    by_software, by_hardware = sets
    assert by_software.ambient is not None
    assert by_hardware.ambient is not None
    before = np.stack([*by_software.images, by_software.ambient]).astype(float)
    after = np.stack([*by_hardware.images, by_hardware.ambient]).astype(float)
    noise_dn = np.sqrt(2.0 * (before / 2.44 + 4.0))  # 10 000 electrons in 4096 levels
    assert np.abs((after - before) / noise_dn).mean() < 1.5
    assert np.abs((after - before).mean(axis=(1, 2))).max() < 1.0


def test_the_five_frames_of_a_set_are_consecutive(rig: Rig) -> None:
    captured = capture_set(rig, "rock")
    assert wrong_light(rig, captured) < WRONG_LIGHT
    metadata = captured.metadata
    assert metadata.synchronisation == rig.config.lights.synchronisation
    *lights, ambient = metadata.images
    assert [image.light for image in (ambient, *lights)] == [None, 0, 1, 2, 3]
    sequences = [image.frames[0].sequence for image in (ambient, *lights)]
    assert sequences == list(range(sequences[0], sequences[0] + 5))
    for image in metadata.images:
        (frame,) = image.frames
        ((begun_us, ended_us),) = image.exposures_us
        assert begun_us / 1e6 == pytest.approx(frame.exposure_start_s, abs=2e-6)
        assert ended_us / 1e6 == pytest.approx(frame.exposure_end_s, abs=2e-6)
        assert len(image.triggers_us) == (metadata.synchronisation == "trigger")
        assert image.led_level_percent == (None if image.light is None else 100)
    assert rig.lights.state().led is None


def test_an_average_is_the_mean_of_several_sequences(rig: Rig) -> None:
    captured = capture_set(rig, average=4)
    assert captured.metadata.full_scale == 65535
    assert wrong_light(rig, captured) < WRONG_LIGHT
    for image in captured.metadata.images:
        assert len(image.frames) == len(image.exposures_us) == 4


def test_the_record_of_a_sequence_is_restored_from_the_file(rig: Rig, tmp_path) -> None:
    captured = capture_set(rig)
    captured.save(tmp_path / "a.ome.tif")
    assert CapturedSet.load(tmp_path / "a.ome.tif").metadata == captured.metadata


def test_without_a_strobe_triggered_frames_are_found_by_their_times(monkeypatch):
    with open_rig(config("trigger")) as rig:
        monkeypatch.setattr(rig.simulation.camera.exposures, "strobe", lambda *_: None)
        captured = capture_set(rig)
        assert wrong_light(rig, captured) < WRONG_LIGHT
        assert captured.metadata.images[0].exposures_us == ()


# timing


@pytest.mark.slow
@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    synchronisation=st.sampled_from(["strobe", "trigger"]),
    period_ms=st.floats(6.0, 50.0),
    exposed_share=st.floats(0.1, 0.99),
    rise_ms=st.floats(0.05, 6.0),
    settle_ms=st.floats(0.0, 15.0),
    turn_us=st.tuples(st.floats(20.0, 200.0), st.floats(200.0, 20_000.0)),
    readout_ms=st.sampled_from([0.0, 0.0, 3.0]),
)
def test_no_timing_lets_wrong_light_into_a_frame(
    synchronisation, period_ms, exposed_share, rise_ms, settle_ms, turn_us, readout_ms
):
    """Slow LEDs, an exposure that fills the period, a slow controller: correct or rejected."""
    try:
        rig_config = config(
            synchronisation,
            lights={"settle_ms": settle_ms},
            camera={"frame_rate_hz": 1e3 / period_ms, "exposure_ms": exposed_share * period_ms},
            simulation={
                "led_rise_ms": rise_ms,
                "led_fall_ms": 0.6 * rise_ms,
                "controller_turn_us": turn_us,
                "readout_ms": min(readout_ms, period_ms),
            },
        )
    except ConfigError:
        return
    with open_rig(rig_config) as rig:
        try:
            captured = capture_set(rig)
        except SetRejected:
            return
        assert wrong_light(rig, captured) < WRONG_LIGHT


@pytest.mark.parametrize(
    ("changes", "frames_per_step"),
    [
        ({}, 1),
        ({"camera": {"exposure_ms": 27.0}}, 1),  # leaves 6.3 ms for 5 ms and the reaction
        ({"camera": {"exposure_ms": 29.0}}, 2),
        ({"camera": {"frame_rate_hz": 60, "exposure_ms": 15.0}}, 2),
        ({"lights": {"settle_ms": 9.0}, "simulation": {"led_rise_ms": 4.0}}, 1),
        ({"lights": {"settle_ms": 45.0}, "simulation": {"led_rise_ms": 20.0}}, 2),
        ({"lights": {"settle_ms": 70.0}, "simulation": {"led_rise_ms": 30.0}}, 3),
    ],
)
def test_a_slow_light_takes_several_frames(changes, frames_per_step):
    with open_rig(config(**changes)) as rig:
        captured = capture_set(rig)
        assert wrong_light(rig, captured) < WRONG_LIGHT
        sequences = [image.frames[0].sequence for image in captured.metadata.images]
        assert np.diff(sequences[:4]).tolist() == [frames_per_step] * 3


def test_a_controller_slower_than_the_pause_is_rejected():
    slow = {"controller_turn_us": (30_000.0, 30_000.0)}
    with open_rig(config(simulation=slow)) as rig, pytest.raises(SetRejected, match="was late"):
        capture_set(rig)


# disturbances


def with_counted_frames(rig: Rig, change: Callable[[Frame, int], Frame | None]) -> Rig:
    """`with_frames` with the number of each frame read."""
    numbers = count()
    return with_frames(rig, lambda frame: change(frame, next(numbers)))


@pytest.mark.parametrize(
    ("change", "cause"),
    [
        (lambda frame, n: None if n == 3 else frame, r"was lost|0 of 4 frames"),
        (lambda frame, n: replace(frame, sequence=frame.sequence - (n == 3)), "came twice"),
        (lambda frame, _: replace(frame, is_corrupt=True), "is corrupt"),
        (
            lambda frame, _: frame.shifted(-0.012),
            r"began -1[12]\.\d ms .*ps4rig rig latency",
        ),
    ],
    ids=["lost", "repeated", "corrupt", "stamped early"],
)
def test_a_disturbed_frame_is_rejected_with_its_cause(rig: Rig, change, cause) -> None:
    try:
        captured = capture_set(with_counted_frames(rig, change))
    except SetRejected as error:
        causes = str(error)
    else:
        (causes,) = captured.metadata.failed_attempts
        assert wrong_light(rig, captured) < WRONG_LIGHT
    assert re.search(cause, causes)
    assert rig.lights.state().led is None
    assert wrong_light(rig, capture_set(rig)) < WRONG_LIGHT


def test_stamps_a_whole_period_early_are_rejected(rig: Rig) -> None:
    # Stamps that are off by a period fit the strobe, but the images do not.
    period_s = rig.camera.info.frame_period_s

    with pytest.raises((SetRejected, CameraError)):
        capture_set(with_frames(rig, lambda frame: frame.shifted(-period_s)))


def test_a_strobe_ahead_of_the_exposure_is_rejected(monkeypatch) -> None:
    with open_rig(config()) as rig:
        exposures = rig.simulation.camera.exposures
        wire = exposures.strobe
        monkeypatch.setattr(
            exposures, "strobe", lambda exposing, at_s: wire(exposing, at_s - 0.003)
        )
        with pytest.raises(SetRejected, match=r"nearest began \+3\.\d ms"):
            capture_set(rig)


@pytest.mark.parametrize(("uncertainty_ms", "is_accepted"), [(0.0, False), (1.0, True)])
def test_stamps_may_be_off_by_their_configured_uncertainty(uncertainty_ms, is_accepted) -> None:
    uncertain = config(
        camera={"timestamp_offset_ms": -2.5, "timestamp_uncertainty_ms": uncertainty_ms}
    )
    with open_rig(uncertain) as rig:
        if is_accepted:
            capture_set(rig)
        else:
            with pytest.raises(SetRejected, match="run ps4rig rig latency"):
                capture_set(rig)


def test_an_unconnected_strobe_is_named(monkeypatch) -> None:
    with open_rig(config()) as rig:
        monkeypatch.setattr(rig.simulation.camera.exposures, "strobe", lambda *_: None)
        with pytest.raises(SetRejected, match="Strobe missing"):
            capture_set(rig)


def test_a_restart_during_a_sequence_is_an_error(rig: Rig) -> None:
    rebooting = rig.config.with_changes(
        simulation={"faults": {"lines": [{"kind": "reboot", "containing": "SEQ:STAT"}]}}
    )
    with open_rig(rebooting) as faulty, pytest.raises(LightControllerError):
        capture_set(faulty)


def test_a_watchdog_during_a_sequence_is_named(rig: Rig) -> None:
    rig.lights.ask("SYST:WDOG 100", 1)
    with pytest.raises(SetRejected, match="Watchdog"):
        capture_set(rig)


@pytest.mark.slow
@settings(max_examples=50, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    synchronisation=st.sampled_from(["strobe", "trigger"]),
    spikes=st.lists(st.tuples(st.floats(0.0, 0.3), st.floats(1e-6, 0.03)), max_size=3),
    missing=st.sets(st.integers(0, 14), max_size=3),
    lost=st.sets(st.integers(0, 9), max_size=2),
)
def test_a_noisy_strobe_never_makes_a_wrong_set(synchronisation, spikes, missing, lost):
    """Spikes of any width at any time, missing edges, lost frames."""
    assume(spikes or missing or lost)
    with open_rig(config(synchronisation)) as rig:
        exposures, clock = rig.simulation.camera.exposures, rig.clock
        wire, edges = exposures.strobe, iter(range(1000))

        def lossy(exposing: bool, at_s: float) -> None:
            if next(edges) not in missing:
                wire(exposing, at_s)

        exposures.strobe = lossy
        start_s = clock.now_s()
        for begin_s, width_s in spikes:
            for at_s, exposing in ((begin_s, True), (begin_s + width_s, False)):
                clock.call_at(start_s + at_s, lambda at=start_s + at_s, on=exposing: wire(on, at))

        def drop(frame: Frame, number: int) -> Frame | None:
            return None if number in lost else frame

        try:
            captured = capture_set(with_counted_frames(rig, drop))
        except (SetRejected, CameraError):
            return
        assert wrong_light(rig, captured) < WRONG_LIGHT


FRAME_FAULTS = [
    *["dropped", "repeated_pixels", "repeated_frame", "torn", "black", "dark", "late"],
    *["stamped_late", "drift", "gone"],
]


@pytest.mark.slow
@pytest.mark.parametrize("synchronisation", ["strobe", "trigger"])
@pytest.mark.parametrize("kind", FRAME_FAULTS)
def test_faulty_frames_never_make_a_wrong_set(synchronisation, kind):
    camera = {"width_px": 64, "height_px": 64}
    with open_rig(config(synchronisation, camera=camera)) as rig:
        truth = capture_set(rig)
    outcomes = []
    for nth in range(1, 16, 2):
        fault = {"kind": kind, "delay_ms": 30.0, "when": {"nth": nth, "times": 2}}
        plan = {"frames": [fault], "seed": nth}
        faulty = config(synchronisation, camera=camera, simulation={"faults": plan})
        with open_rig(faulty) as rig:
            try:
                captured = capture_set(rig)
            except (SetRejected, CameraError) as error:
                outcomes.append(str(error))
                continue
        outcomes.append("accepted")
        noise_dn = np.sqrt(2.0 * (truth.images / 2.44 + 4.0))
        difference = np.abs(captured.images.astype(float) - truth.images)
        assert (difference / noise_dn).mean() < 1.2, (nth, captured.metadata.failed_attempts)
    assert outcomes
