"""How long sets take: switched by software, and by the controller, against what is possible."""

from __future__ import annotations

import statistics
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

from capture.errors import SetRejected
from capture.sets.captured_set import CapturedSet
from rig import RigConfig, open_rig
from rig.latency.switch import measure_switch_latency

from .attempts import capture_set

__all__ = ["SetTiming", "compared_configs", "measure_set_timing"]

Synchronisation = Literal["software", "strobe", "trigger"]
_SYNCHRONISATIONS: tuple[Synchronisation, ...] = ("software", "strobe", "trigger")
# Frames per second, and exposures that leave the lights time to settle between them.
_SIMULATED_MODES = ((30.0, 20.0), (60.0, 8.0))


@dataclass(frozen=True)
class SetTiming:
    """What sets took on the rig's clock, all times in milliseconds.

    Attributes
    ----------
    synchronisation, frame_rate_hz, exposure_ms, clock
        How they were taken; the clock is ``real`` or ``virtual``.
    accepted, rejected
        Sets.
    switch_ms
        By software from the command to its acknowledge, on the strobe from the end of exposure to
        the change of the light; the median. None by trigger, where nothing is waited for.
    median_ms, worst_ms
        From asking for a set to having it; None if all were rejected.
    exposures_ms
        From the beginning of the first exposure to the end of the last, the median.
    limit_ms
        One frame period for each image: no camera is faster.
    """

    synchronisation: Synchronisation
    frame_rate_hz: float
    exposure_ms: float
    clock: Literal["real", "virtual"]
    accepted: int
    rejected: int
    switch_ms: float | None
    median_ms: float | None
    worst_ms: float | None
    exposures_ms: float | None
    limit_ms: float


def compared_configs(config: RigConfig) -> Iterator[RigConfig]:
    """Of a simulated rig all modes at 30 and 60 frames per second, of another its own."""
    if config.is_simulated:
        for clock in ("virtual", "real"):
            for frame_rate_hz, exposure_ms in _SIMULATED_MODES:
                for synchronisation in _SYNCHRONISATIONS:
                    yield config.with_changes(
                        simulation={"clock": clock},
                        camera={"frame_rate_hz": frame_rate_hz, "exposure_ms": exposure_ms},
                        lights={"synchronisation": synchronisation},
                    )
        return
    if config.lights.synchronisation == "strobe":
        # A camera that is set to wait for triggers gives no frame to software.
        yield config.with_changes(lights={"synchronisation": "software"})
    yield config


def measure_set_timing(config: RigConfig, sets: int) -> SetTiming:
    """Take sets until so many are good, or as many again are rejected.

    Raises
    ------
    HardwareError
        If the controller or the camera fails.
    """
    taken: list[CapturedSet] = []
    durations_s: list[float] = []
    rejected = 0
    with open_rig(config) as rig:
        synchronisation = config.lights.synchronisation
        switch_ms = None
        if synchronisation == "software":
            switch_ms = measure_switch_latency(rig.lights, rig.clock).median_ms
        while len(taken) < sets and rejected < sets:
            asked_s = rig.clock.now_s()
            try:
                taken.append(capture_set(rig))
                durations_s.append(rig.clock.now_s() - asked_s)
            except SetRejected:
                rejected += 1
        if taken and synchronisation == "strobe":
            switch_ms = statistics.median(ms for one in taken for ms in _reactions_ms(one))
        info = rig.camera.info
        simulated_virtual = config.is_simulated and config.simulation.clock == "virtual"
        return SetTiming(
            synchronisation=synchronisation,
            frame_rate_hz=1.0 / info.frame_period_s,
            exposure_ms=1e3 * info.exposure_s,
            clock="virtual" if simulated_virtual else "real",
            accepted=len(taken),
            rejected=rejected,
            switch_ms=switch_ms,
            median_ms=1e3 * statistics.median(durations_s) if taken else None,
            worst_ms=1e3 * max(durations_s) if taken else None,
            exposures_ms=1e3 * statistics.median(map(_exposures_s, taken)) if taken else None,
            limit_ms=1e3 * (1 + len(rig.lighting)) * info.frame_period_s,
        )


def _exposures_s(captured: CapturedSet) -> float:
    frames = [frame for image in captured.metadata.images for frame in image.frames]
    first_s = min(frame.exposure_start_s for frame in frames)
    return max(frame.exposure_end_s for frame in frames) - first_s


def _reactions_ms(captured: CapturedSet) -> Iterator[float]:
    """From the end of each exposure on the strobe line to the change of the light."""
    *lights, ambient = captured.metadata.images
    for before, after in pairwise((ambient, *lights)):
        if after.controller_time_us is not None:
            yield 1e-3 * (after.controller_time_us - before.exposures_us[-1][1])
