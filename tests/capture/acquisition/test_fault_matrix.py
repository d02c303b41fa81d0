"""Every injected fault leads to a good set, or to a rejected one with its cause.

An accepted set is wrong if one of its images, minus the ambient image, differs from that of a rig
without faults and noise by more than `TOLERANCE` of its signal, rms over the frame, beyond noise.
Where flat, dark, small images leave LED levels uncertain, five of the standard errors that the set
records are allowed. One factor for all images of a set is free, because only a reference could tell
how bright a surface is.

    pytest -m slow tests/capture/acquisition/test_fault_matrix.py  # shows the table of random sets
"""

import random
import re
from collections import Counter, defaultdict
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from capture import CapturedSet, SetRejected, capture_set
from rig import HardwareError, Placement, Rig, RigConfig, open_rig

TOLERANCE = 0.05
RANDOM_SETS = 2000
SURFACES = ("rock", "sand", "malv", "ogil", "cobbles", "rock_speckled", "Fabric018")


def rig_with(plan: dict[str, Any], **camera: object) -> RigConfig:
    return RigConfig().with_changes(
        camera={"width_px": 64, "height_px": 64, **camera}, simulation={"faults": plan}
    )


def error_of(captured: CapturedSet, rig: Rig) -> float:
    """Largest relative rms error of an image."""
    camera = rig.simulation.camera
    sensor, scene = camera.sensor, camera.scene
    dn_per_light = 1e3 * camera.info.exposure_s * sensor.white_e_per_ms / sensor.gain_e_per_dn
    truth = dn_per_light * scene.lights.astype(np.float64)
    signals = captured.images.astype(np.float64) - captured.ambient
    truth *= (signals * truth).sum() / (truth * truth).sum()
    both = captured.images + captured.ambient.astype(np.float64) - 2.0 * sensor.black_level_dn
    noise = 2.0 * (sensor.read_noise_dn**2 + 1 / 12) + np.maximum(both, 0) / sensor.gain_e_per_dn
    beyond = ((signals - truth) ** 2 - noise).mean(axis=(1, 2)) / (truth**2).mean(axis=(1, 2))
    return float(np.sqrt(np.maximum(beyond, 0.0)).max())


def outcome(config: RigConfig) -> tuple[str, str, float]:
    """The end (good, retried, rejected or wrong), the causes, and an accepted set's error."""
    try:
        with open_rig(config) as rig:
            captured = capture_set(rig)
            error = error_of(captured, rig)
    except (SetRejected, HardwareError) as rejection:
        return "rejected", str(rejection), 0.0
    causes = "; ".join(captured.metadata.failed_attempts)
    if error > max(TOLERANCE, 5.0 * (captured.metadata.checks.light_levels_error or 0.0)):
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
    ("dead", led("dead"), "rejected", "LED 1 .* dark, .* the LED is dead"),
    ("dim by 3 %", led("dim", share=0.03), "good", ""),
    ("dim by 8 %", led("dim", share=0.08), "rejected", "LED 1 .* gives 92% .* an LED is weak"),
    ("dim by half", led("dim", share=0.5), "rejected", "LED 1 .* gives 50% .* an LED is weak"),
    ("dim for a while", led("dim", share=0.5, until_s=0.25), "retried", "LED 1 .* an LED is weak"),
    ("stuck on", led("stuck_on", share=1.0), "rejected", "LED 1 .*always on"),
    ("stuck on at a third", led("stuck_on", share=0.33), "rejected", "LED 1 .*: it stays on"),
    ("stuck on from then on", led("stuck_on", share=0.3, from_s=0.15), "rejected", "stays on"),
    ("stuck on for a while", led("stuck_on", from_s=0.1, until_s=0.2), "retried", "stays on"),
    ("flicker", led("flicker", share=0.8, frequency_hz=3.3), "rejected|retried", "LED 1.*flickers"),
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
def test_each_fault_has_its_end_and_cause(plan: dict[str, Any], end: str, cause: str) -> None:
    ended, causes, error = outcome(rig_with(plan))
    assert re.fullmatch(end, ended), (ended, causes, error)
    assert re.search(cause, causes), (ended, causes, error)


# at random


def random_when(chance: random.Random) -> dict[str, Any]:
    return chance.choice(
        [
            {},
            {"nth": chance.randint(1, 24), "times": chance.randint(1, 4)},
            {"probability": chance.choice([0.02, 0.1, 0.4])},
            {"from_s": chance.uniform(0.0, 0.5)},
            {"from_s": (begun_s := chance.uniform(0.0, 0.4)), "until_s": begun_s + 0.1},
        ]
    )


def random_line_fault(chance: random.Random) -> dict[str, Any]:
    # A lost line costs a whole time-out of the driver, in real time.
    kinds = ["garble", "double", "lose_byte", "double_byte", "truncate", "delay", "reboot", "lose"]
    kind = chance.choices([*kinds, "late"], [4, 4, 2, 4, 1, 3, 1, 1, 1])[0]
    to_host = kind != "reboot" and chance.random() < 0.5
    return {
        "kind": kind,
        "direction": "to_host" if to_host else "to_controller",
        "containing": chance.choice(["LED:SEL", "LED:SEL 2", "LED:OFF", "LED:STAT", "LED"]),
        "delay_ms": chance.uniform(0.0, 300.0),
        "when": {"nth": chance.randint(1, 8), "times": chance.randint(1, 2)},
    }


def random_led_fault(chance: random.Random) -> dict[str, Any]:
    kind = chance.choice(["dead", "dim", "stuck_on", "flicker", "unsteady", "swapped"])
    first, other = chance.sample(range(4), 2)
    fault: dict[str, Any] = {
        "kind": kind,
        "led": first,
        "share": chance.choice([chance.uniform(0.0, 0.2), chance.uniform(0.0, 1.0)]),
        "frequency_hz": 10.0 ** chance.uniform(-0.5, 3.0),
    }
    if kind == "swapped":
        return fault | {"other": other}
    when = random_when(chance)
    return fault | {key: when[key] for key in ("from_s", "until_s") if key in when}


def random_frame_fault(chance: random.Random) -> dict[str, Any]:
    kinds = ["dropped", "repeated_pixels", "repeated_frame", "torn", "black", "dark", "late"]
    return {
        "kind": chance.choice([*kinds, "stamped_late", "drift", "gone"]),
        "row_share": chance.uniform(0.02, 0.98),
        "frames_back": chance.randint(1, 4),
        "delay_ms": 10.0 ** chance.uniform(0.0, 2.0),
        "rate_per_s": chance.uniform(-1.0, 1.0),
        "when": random_when(chance),
    }


FAMILIES = {"lines": random_line_fault, "leds": random_led_fault, "frames": random_frame_fault}


def random_set(seed: int) -> tuple[str, RigConfig]:
    """One or two faults, with a random surface and camera."""
    chance = random.Random(seed)
    plan: dict[str, Any] = {"seed": seed}
    names = []
    for family in chance.choices(list(FAMILIES), [1, 2, 2], k=chance.choice([1, 1, 2])):
        fault = FAMILIES[family](chance)
        plan[family] = [*plan.get(family, []), fault]
        names.append(fault["kind"])
    config = rig_with(
        plan,
        bits=chance.choice([8, 12]),
        frame_rate_hz=chance.choice([30.0, 47.0]),
        exposure_ms=chance.choice([12.0, 20.0]),
    )
    placement = {"surface": chance.choice(SURFACES), "rotate_deg": chance.choice([0, 20, 70])}
    return " + ".join(sorted(names)), config.with_changes(
        lights={"slant_deg": chance.choice([35.0, 45.0, 55.0])},
        simulation={"placement": {**Placement().model_dump(), **placement}},
    )


@pytest.mark.slow
def test_no_random_fault_makes_a_wrong_set(
    show_figures: Callable[[str], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    # Other programs are searched for at each start: a tenth of the time.
    monkeypatch.setattr("rig.lights.serial_line.port_holders", lambda _: [])
    ends: dict[str, Counter[str]] = defaultdict(Counter)
    wrong = []
    for seed in range(RANDOM_SETS):
        kinds, config = random_set(seed)
        end, causes, error = outcome(config)
        ends[kinds if "+" not in kinds else "two faults"][end] += 1
        if end == "wrong":
            wrong.append((seed, kinds, round(error, 3), causes))
    columns = ("good", "retried", "rejected", "wrong")
    lines = [f"{'fault':18}" + "".join(f"{column:>10}" for column in columns)]
    for kinds, counts in [*sorted(ends.items()), ("all", sum(ends.values(), Counter()))]:
        lines.append(f"{kinds:18}" + "".join(f"{counts[column]:10}" for column in columns))
    show_figures("\n".join(lines))
    assert wrong == []
