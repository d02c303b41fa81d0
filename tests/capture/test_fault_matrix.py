"""Every fault on purpose, against `capture_set`: a good set, or a refused one with its cause.

An accepted set is wrong if one of its images, ambient light subtracted, differs from what a rig
without fault and without noise would have given by more than `TOLERANCE` of its signal, rms over
the frame, beyond what noise explains. One factor for all images of the set is free: how bright a
surface is only a reference could tell.

    pytest -s tests/capture/test_fault_matrix.py     # prints the table of the random sets
"""

import functools
import re
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from capture import CapturedSet, SetRejected, capture_set
from rig import HardwareError, Rig, RigConfig, open_rig, simulation

TOLERANCE = 0.05
RANDOM_SETS = 2000
SURFACES = ("rock", "sand", "malv", "ogil", "cobbles", "rock_speckled", "grey_roof_tiles_02")


@pytest.fixture(autouse=True, scope="module")
def surfaces_are_made_once() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(simulation, "_load", functools.cache(simulation._load))
        yield


def rig_with(plan: dict[str, Any], **camera: object) -> RigConfig:
    return RigConfig().with_changes(
        camera={"width_px": 64, "height_px": 64, **camera}, simulation={"faults": plan}
    )


def error_of(captured: CapturedSet, rig: Rig) -> float:
    """The largest relative rms error of an image."""
    assert rig.simulation is not None
    assert captured.ambient is not None
    camera = rig.simulation.camera
    sensor, scene = camera._sensor, camera._scene
    dn_per_light = 1e3 * camera.info.exposure_s * sensor.white_e_per_ms / sensor.gain_e_per_dn
    truth = dn_per_light * scene.lights.astype(np.float64)
    taken = captured.images.astype(np.float64) - captured.ambient
    truth *= (taken * truth).sum() / (truth * truth).sum()
    both = captured.images + captured.ambient.astype(np.float64) - 2.0 * sensor.black_level_dn
    noise = 2.0 * (sensor.read_noise_dn**2 + 1 / 12) + np.maximum(both, 0) / sensor.gain_e_per_dn
    beyond = ((taken - truth) ** 2 - noise).mean(axis=(1, 2)) / (truth**2).mean(axis=(1, 2))
    return float(np.sqrt(np.maximum(beyond, 0.0)).max())


def outcome(config: RigConfig) -> tuple[str, str, float]:
    """(good, retried, rejected or wrong; the causes; the error of an accepted set)."""
    try:
        with open_rig(config) as rig:
            captured = capture_set(rig)
            error = error_of(captured, rig)
    except (SetRejected, HardwareError) as refusal:
        return "rejected", str(refusal), 0.0
    causes = "; ".join(captured.metadata.retries)
    if error > TOLERANCE:
        return "wrong", causes, error
    return "retried" if causes else "good", causes, error


# every kind


def line(kind: str, direction: str = "to_controller", **fields: object) -> dict[str, Any]:
    fault = {"kind": kind, "direction": direction, "containing": "LED:SEL 1", **fields}
    return {"lines": [fault]}


def led(kind: str, **fields: object) -> dict[str, Any]:
    return {"leds": [{"kind": kind, "led": 1, **fields}]}


def frame(kind: str, **fields: object) -> dict[str, Any]:
    return {"frames": [{"kind": kind, **fields}]}


ONCE = {"nth": 1}
LINK = r"no answer|garbled|refused|unexpected|restarted|gave up|not understood"
MATRIX: list[tuple[str, dict[str, Any], str, str]] = [
    *(
        (f"{kind} {direction}", line(kind, direction, when=ONCE), "retried", LINK)
        for kind in ("lose", "garble", "truncate", "lose_byte", "double_byte", "late")
        for direction in ("to_controller", "to_host")
    ),
    ("double to_controller", line("double", when=ONCE), "good", ""),
    ("double to_host", line("double", "to_host", when=ONCE), "good", ""),
    ("delay to_controller", line("delay", delay_ms=120), "good", ""),
    ("delay to_host", line("delay", "to_host", delay_ms=120), "good", ""),
    ("reboot", line("reboot", when=ONCE), "retried", LINK),
    ("lose, always", line("lose"), "rejected", "no answer"),
    ("garble, always", line("garble", "to_host"), "rejected", LINK),
    ("reboot, always", line("reboot"), "rejected", LINK),
    ("dead", led("dead"), "rejected", "LED 1 .* dark, .* is the LED dead"),
    ("dim by 3 %", led("dim", share=0.03), "good", ""),
    ("dim by 8 %", led("dim", share=0.08), "rejected", "LED 1 .* gives 92% .* an LED is weak"),
    ("dim by half", led("dim", share=0.5), "rejected", "LED 1 .* gives 50% .* an LED is weak"),
    ("dim for a while", led("dim", share=0.5, until_s=0.25), "retried", "LED 1 .* an LED is weak"),
    ("stuck on", led("stuck_on", share=1.0), "rejected", "LED 1 .*always on"),
    ("stuck on at a third", led("stuck_on", share=0.33), "rejected", "LED 1 .*: it stays on"),
    ("stuck on from then on", led("stuck_on", share=0.3, from_s=0.15), "rejected", "stays on"),
    ("stuck on for a while", led("stuck_on", from_s=0.1, until_s=0.2), "retried", "stays on"),
    ("flicker", led("flicker", share=0.8, frequency_hz=3.3), "rejected", "LED 1 .*flickers"),
    ("unsteady", led("unsteady", frequency_hz=1000), "rejected", "LED 1 .*an LED is weak, flick"),
    ("swapped opposite", led("swapped", other=3), "rejected", "order .* under tilts 0, 270, 180"),
    ("swapped beside", led("swapped", other=2), "rejected", "order .* tilts 0, 180, 90, 270"),
    ("dropped", frame("dropped", when={"probability": 0.5}), "good", ""),
    ("repeated frames", frame("repeated_frame", when={"probability": 0.5}), "good", ""),
    ("repeated pixels", frame("repeated_pixels", when={"nth": 4}), "good", ""),
    ("repeated pixels, always", frame("repeated_pixels"), "rejected", "older than its"),
    ("torn", frame("torn", when={"nth": 6}), "retried", "a frame was torn"),
    ("torn at the last row", frame("torn", row_share=0.98), "rejected", "torn or older"),
    ("torn, always", frame("torn"), "rejected", "torn or older"),
    ("black", frame("black", when={"nth": 6}), "good", ""),
    ("black, always", frame("black"), "rejected", "no good frame under LED"),
    ("dark", frame("dark", when={"nth": 6}), "retried", "dark"),
    ("dark, always", frame("dark"), "rejected", "dark"),
    ("late", frame("late", delay_ms=70), "good", ""),
    ("stamped late", frame("stamped_late", delay_ms=3), "good", ""),
    ("stamped in the future", frame("stamped_late"), "rejected", "not on the rig's clock"),
    (
        "late and stamped late",
        {"frames": [{"kind": kind, "delay_ms": 30} for kind in ("late", "stamped_late")]},
        "rejected",
        "older than its time stamp",
    ),
    ("drift", frame("drift", rate_per_s=-0.9), "rejected", "the exposure drifts"),
    ("gone", frame("gone", when={"nth": 5}), "rejected", "the camera is gone"),
]


@pytest.mark.parametrize(("plan", "end", "cause"), [case[1:] for case in MATRIX],
                         ids=[case[0] for case in MATRIX])  # fmt: skip
def test_each_fault_ends_as_it_should(plan: dict[str, Any], end: str, cause: str) -> None:
    ended, causes, error = outcome(rig_with(plan))
    assert (ended, bool(re.search(cause, causes))) == (end, True), (ended, causes, error)
