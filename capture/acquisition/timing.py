"""Measure how long sets take, with lights switched by software and by the controller."""

import statistics
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

from capture.base.errors import SetRejected
from capture.sets.captured_set import CapturedSet
from rig import RigConfig, open_rig
from rig.lights.driver import switch_latencies_ms

from .attempts import capture_set

# Frame rates in Hz with exposures in ms. The rest of each period suffices for an LED to settle.
_SIMULATED_MODES = ((30.0, 20.0), (60.0, 8.0))


@dataclass(frozen=True)
class _SetTiming:
    """Durations of sets on the rig's clock."""

    synchronisation: Literal["software", "strobe", "trigger"]
    frame_rate_hz: float
    exposure_ms: float
    clock: Literal["real", "virtual"]
    accepted: int
    rejected: int
    # Median switch latency: by software from the command to its acknowledgement, with a strobe from
    # the end of the exposure to the change of the light; None with a trigger.
    switch_ms: float | None
    # Duration of `capture_set`; None if all sets were rejected.
    median_ms: float | None
    worst_ms: float | None
    exposures_ms: float | None  # median from the start of the first exposure to the end of the last
    limit_ms: float  # for `exposures_ms`: one frame period per light and for the ambient image


def compared_configs(config: RigConfig) -> Iterator[RigConfig]:
    """Yield all modes of a simulated rig, or the mode of a real one.

    A real rig with a strobe is also measured by software, first.
    """
    if config.is_simulated:
        for clock in ("virtual", "real"):
            for frame_rate_hz, exposure_ms in _SIMULATED_MODES:
                for synchronisation in ("software", "strobe", "trigger"):
                    yield config.with_changes(
                        simulation={"clock": clock},
                        camera={"frame_rate_hz": frame_rate_hz, "exposure_ms": exposure_ms},
                        lights={"synchronisation": synchronisation},
                    )
        return
    if config.lights.synchronisation == "strobe":
        # Not with triggers: a camera that waits for them delivers no frame by software.
        yield config.with_changes(lights={"synchronisation": "software"})
    yield config


def measure_set_timing(config: RigConfig, sets: int) -> _SetTiming:
    """Capture sets until `sets` of them are accepted, or as many rejected."""
    accepted: list[CapturedSet] = []
    durations_s: list[float] = []
    rejected = 0
    with open_rig(config) as rig:
        synchronisation = config.lights.synchronisation
        switch_ms = None
        if synchronisation == "software":
            switch_ms = statistics.median(switch_latencies_ms(rig.lights, rig.clock))
        while len(accepted) < sets and rejected < sets:
            start_s = rig.clock.now_s()
            try:
                accepted.append(capture_set(rig))
                durations_s.append(rig.clock.now_s() - start_s)
            except SetRejected:
                rejected += 1
        if accepted and synchronisation == "strobe":
            switch_ms = statistics.median(
                ms for captured in accepted for ms in _switch_latencies_ms(captured)
            )
        info = rig.camera.info
        clock = config.simulation.clock if config.is_simulated else "real"
        return _SetTiming(
            synchronisation=synchronisation,
            frame_rate_hz=1.0 / info.frame_period_s,
            exposure_ms=1e3 * info.exposure_s,
            clock=clock,
            accepted=len(accepted),
            rejected=rejected,
            switch_ms=switch_ms,
            median_ms=1e3 * statistics.median(durations_s) if accepted else None,
            worst_ms=1e3 * max(durations_s) if accepted else None,
            exposures_ms=1e3 * statistics.median(map(_exposures_s, accepted)) if accepted else None,
            limit_ms=1e3 * (1 + len(rig.lighting)) * info.frame_period_s,
        )


def _exposures_s(captured: CapturedSet) -> float:
    frames = [frame for image in captured.metadata.images for frame in image.frames]
    first_s = min(frame.exposure_start_s for frame in frames)
    return max(frame.exposure_end_s for frame in frames) - first_s


def _switch_latencies_ms(captured: CapturedSet) -> Iterator[float]:
    """Time from the end of each exposure on the strobe line to the change of the light."""
    *lights, ambient = captured.metadata.images  # the ambient image is captured first, stored last
    for before, after in pairwise((ambient, *lights)):
        if after.controller_time_us is not None:
            yield 1e-3 * (after.controller_time_us - before.exposures_us[-1][1])
