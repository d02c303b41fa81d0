"""What every light controller does, over every kind of connection."""

from typing import Any

import pytest

from rig import LightControllerError


def test_it_identifies_itself(controller: Any) -> None:
    with controller.open() as lights:
        assert lights.identity.vendor == "PS4RIG"
        assert lights.led_count == 4


def test_one_led_at_a_time_in_any_order(controller: Any) -> None:
    with controller.open() as lights:
        for led in (3, 0, 2, 2, 1):
            assert lights.select(led).led == led
            assert controller.lit() == [led]
        assert lights.off().led is None
        assert controller.lit() == []


def test_the_light_changes_before_the_acknowledge(controller: Any) -> None:
    with controller.open() as lights:
        before_s = controller.clock.now_s()
        switch = lights.select(1)
        assert before_s <= switch.acknowledged_s <= controller.clock.now_s()
        controller.clock.sleep_s(0.01)
        # The LED starts to rise after the request and is half up 1 ms after the acknowledgement.
        assert controller.board.output(1, before_s) == 0.0
        assert controller.board.output(1, switch.acknowledged_s + 0.001) > 0.5


def test_controller_times_increase(controller: Any) -> None:
    with controller.open() as lights:
        times = [lights.select(led).controller_time_us for led in range(4)]
        times.append(lights.off().controller_time_us)
    assert times == sorted(times)
    assert times[0] < times[3]


def test_each_led_keeps_its_level(controller: Any) -> None:
    with controller.open() as lights:
        lights.set_level(2, 40)
        lights.set_level(0, 0)
        assert lights.state().levels_percent == (0, 100, 40, 100)


def test_an_impossible_request_is_refused_and_changes_nothing(controller: Any) -> None:
    with controller.open() as lights:
        lights.select(2)
        for wrong in (lambda: lights.select(9), lambda: lights.set_level(0, 200)):
            with pytest.raises(LightControllerError, match="refused"):
                wrong()
        lights.confirm(2)
        assert controller.lit() == [2]


def test_confirm_fails_when_another_led_is_lit(controller: Any) -> None:
    with controller.open() as lights:
        lights.confirm(None)
        lights.select(1)
        lights.confirm(1)
        for other in (None, 0):
            with pytest.raises(LightControllerError, match="LED 1 is"):
                lights.confirm(other)


def test_the_watchdog_puts_the_leds_out_when_the_host_is_silent(controller: Any) -> None:
    with controller.open(watchdog_ms=150) as lights:
        lights.select(3)
        controller.clock.sleep_s(0.25)
        assert controller.lit() == []
        with pytest.raises(LightControllerError, match="Watchdog"):
            lights.confirm(3)


def test_close_puts_the_leds_out_and_the_next_program_can_open_it(controller: Any) -> None:
    for led in (1, 2):
        with controller.open() as lights:
            lights.select(led)
            assert controller.lit() == [led]
        lights.close()
        # The last bytes may still be on their way when a socket has been closed.
        controller.clock.sleep_s(0.02)
        assert controller.lit() == []


def test_an_unplugged_controller_is_an_error_and_dark(controller: Any) -> None:
    with controller.open() as lights:
        lights.select(1)
        controller.server.stop()
        with pytest.raises(LightControllerError, match=r"gone|hangs"):
            lights.select(2)
    assert controller.lit() == []
