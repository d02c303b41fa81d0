"""After a failure `recover` opens the line to the same controller again."""

import string
from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from capture import capture_set
from rig import LightControllerError, RigConfig, open_rig
from rig.lights.driver import LightController
from rig.lights.link import LinkTimeouts, encode_command

SMALL = RigConfig().with_changes(camera={"width_px": 48, "height_px": 48})
SHORT = LinkTimeouts(recover_s=0.3)


def test_without_a_failure_nothing_is_done(bench: Any) -> None:
    with LightController(bench.port, clock=bench.clock) as lights:
        lights.select(1)
        link = lights._link
        lights.recover()
        assert lights._link is link
        assert bench.lit() == [0.0, 1.0, 0.0, 0.0]


def test_a_refused_command_is_not_a_failure_of_the_line(bench: Any) -> None:
    with LightController(bench.port, clock=bench.clock) as lights:
        with pytest.raises(LightControllerError, match="refused"):
            lights.select(9)
        link = lights._link
        lights.recover()
        assert lights._link is link


def test_a_controller_plugged_in_at_another_port_is_found() -> None:
    with open_rig(SMALL, timeouts=SHORT) as rig:
        assert rig.simulation is not None
        rig.lights.set_level(2, 98)
        capture_set(rig)
        rig.simulation.unplug_lights()
        with pytest.raises(LightControllerError, match="gone"):
            capture_set(rig)
        rig.simulation.replug_lights()
        capture_set(rig)
        assert rig.lights.port == rig.simulation.port
        assert rig.lights.state().levels_percent == (100, 100, 98, 100)
        assert rig.lights.state().led is None


def test_an_unplugged_controller_is_named_as_missing() -> None:
    with open_rig(SMALL, timeouts=SHORT) as rig:
        assert rig.simulation is not None
        rig.simulation.unplug_lights()
        with pytest.raises(LightControllerError):
            rig.lights.off()
        with pytest.raises(LightControllerError, match="SIM-0001 is not plugged"):
            rig.lights.recover()
        rig.simulation.replug_lights()
        rig.lights.recover()
        assert rig.lights.select(3).led == 3


def test_a_recovery_that_was_refused_is_made_again(
    bench: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    with LightController(bench.port, clock=bench.clock) as lights:
        lights.set_level(0, 40)
        with pytest.raises(LightControllerError):
            lights.ask("*IDN?", 1)  # not a number
        monkeypatch.setattr("rig.lights.link.encode_command", damaged_level)
        with pytest.raises(LightControllerError):
            lights.recover()
        monkeypatch.undo()
        lights.recover()
        assert lights.state().levels_percent[0] == 40


def damaged_level(sequence: int, command: str) -> bytes:
    return encode_command(sequence, command).replace(b"LEV 0,40", b"LEV 0,4!")


def test_recovery_waits_for_a_controller_that_restarts() -> None:
    with open_rig(SMALL) as rig:
        assert rig.simulation is not None
        rig.lights.select(1)
        controller: Any = rig.simulation.controller
        controller.reset()
        with pytest.raises(LightControllerError, match=r"restarted|no answer"):
            rig.lights.confirm(1)
        rig.lights.recover()
        assert rig.lights.state().led is None


def test_a_restarted_controller_gets_its_settings_again(bench: Any) -> None:
    with LightController(bench.port, clock=bench.clock, watchdog_ms=700) as lights:
        lights.set_level(1, 30)
        lights.select(1)
        bench.clock.sleep_s(0.2)
        bench.controller.reset()
        bench.clock.sleep_s(0.4)
        bench.controller.take_output()  # the banner is lost
        with pytest.raises(LightControllerError, match="should be lit"):
            lights.confirm(1)
        lights.recover()
        assert lights.state().levels_percent == (100, 30, 100, 100)
        lights.select(1)
        bench.clock.sleep_s(0.9)
        assert lights.state().led is None  # the watchdog time is 0.7 s again


def fail(lights: LightController) -> None:
    lights._link._line.close()
    with pytest.raises(LightControllerError):
        lights.off()


def test_the_same_controller_is_found_among_several(served_port: Callable[[str], str]) -> None:
    first, other, again = served_port("A-1"), served_port("B-2"), served_port("A-1")
    with LightController(first, possible_ports=lambda: ("/dev/ttyNONE", other, again)) as lights:
        fail(lights)
        lights.recover()
        assert lights.port == again
        assert lights.identity.serial_number == "A-1"


def test_another_controller_in_its_place_is_refused(served_port: Callable[[str], str]) -> None:
    first, other = served_port("A-1"), served_port("B-2")
    with LightController(first, possible_ports=lambda: (other,), timeouts=SHORT) as lights:
        fail(lights)
        with pytest.raises(LightControllerError, match=r"B-2 .*in place of A-1"):
            lights.recover()
        with pytest.raises(LightControllerError):
            lights.select(0)
    with LightController(other) as lights:  # its port was released
        assert lights.identity.serial_number == "B-2"


class Damage:
    """Damages replies as planned."""

    def __init__(self) -> None:
        self.plan: list[tuple[str, int]] = []
        self.late: list[bytes] = []

    def __call__(self, _command: str, reply: bytes) -> Iterable[bytes]:
        late, self.late = self.late, []
        if not self.plan or not reply:
            return [*late, reply]
        kind, number = self.plan.pop(0)
        if kind == "late":  # comes before the next reply
            self.late = [reply]
            return late
        if kind == "doubled":
            return [*late, reply, reply]
        if kind == "truncated":
            return [*late, reply[: number % len(reply)]]
        if kind == "garbled":
            at = number % len(reply)
            letter = string.printable[number % 97].encode()
            return [*late, reply[:at] + letter + reply[at + 1 :]]
        if kind == "noise":
            return [*late, bytes([number % 256]) * (number % 7), reply]
        if kind == "banner":
            return [*late, b"READY PS4RIG,LED4,SIM-0001,1.0.0,1\n", reply]
        return [*late, reply]


KINDS = st.sampled_from(["late", "doubled", "truncated", "garbled", "noise", "banner", "whole"])


def test_damaged_replies_never_acknowledge_a_switch_that_did_not_happen(
    damaged_device: Callable[[Any], Any],
) -> None:
    damage = Damage()
    line = damaged_device(damage)

    @settings(max_examples=25, deadline=None, derandomize=True)
    @given(st.lists(st.tuples(KINDS, st.integers(0, 10_000)), max_size=6))
    def play(plan: list[tuple[str, int]]) -> None:
        damage.plan, damage.late = list(plan), []
        for number in range(8):
            led = number % 4
            with suppress(LightControllerError):
                assert lights.select(led).led == led
                # An acknowledged switch has happened.
                line.clock.sleep_s(0.01)
                assert line.board.output(led, line.clock.now_s()) > 0.99
        damage.plan, damage.late = [], []
        # A busy machine may be slower than the short time-out, here and when it is opened.
        assert any(recovered() for _ in range(100))

    def opened() -> LightController | None:
        with suppress(LightControllerError):
            return LightController(line.port, timeouts=LinkTimeouts(reply_s=0.03))
        return None

    def recovered() -> bool:
        with suppress(LightControllerError):
            lights.recover()
            return lights.select(3).led == 3 and lights.off().led is None
        return False

    lights = next(filter(None, (opened() for _ in range(100))))
    try:
        play()
    finally:
        with suppress(LightControllerError):
            lights.close()
