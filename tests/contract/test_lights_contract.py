"""What every light controller does, whatever it is connected by."""

from typing import Any

import pytest

from rig import LightControllerError


def test_it_says_who_it_is(controller: Any) -> None:
    with controller.open() as lights:
        assert lights.identity.vendor == "PS4RIG"
        assert lights.led_count == 4


def test_all_leds_are_out_once_it_is_open(controller: Any) -> None:
    with controller.open() as lights:
        assert controller.lit() == []
        assert lights.state().led is None


def test_one_led_at_a_time_in_any_order(controller: Any) -> None:
    with controller.open() as lights:
        for led in (3, 0, 2, 2, 1):
            assert lights.select(led).led == led
            assert controller.lit() == [led]
        assert lights.off().led is None
        assert controller.lit() == []


def test_the_light_is_new_once_it_is_acknowledged(controller: Any) -> None:
    with controller.open() as lights:
        before_s = controller.clock.now_s()
        switch = lights.select(1)
        assert before_s <= switch.acknowledged_s <= controller.clock.now_s()
        controller.clock.sleep_s(0.01)
        # The whole rise from 0 lies after the question, and half of it before acknowledge + 1 ms.
        assert controller.board.output(1, before_s) == 0.0
        assert controller.board.output(1, switch.acknowledged_s + 0.001) > 0.5


def test_controller_times_only_grow(controller: Any) -> None:
    with controller.open() as lights:
        times = [lights.select(led).controller_time_us for led in range(4)]
        times += [lights.off().controller_time_us, lights.state().controller_time_us]
    assert times == sorted(times)
    assert times[0] < times[3]


def test_levels_are_kept_per_led(controller: Any) -> None:
    with controller.open() as lights:
        lights.set_level(2, 40)
        lights.set_level(0, 0)
        assert lights.state().levels_percent == (0, 100, 40, 100)


def test_what_it_cannot_do_it_refuses_and_goes_on(controller: Any) -> None:
    with controller.open() as lights:
        lights.select(2)
        for wrong in (lambda: lights.select(9), lambda: lights.set_level(0, 200)):
            with pytest.raises(LightControllerError, match="refused"):
                wrong()
        lights.confirm(2)
        assert controller.lit() == [2]


def test_confirm_tells_what_is_lit_from_what_should_be(controller: Any) -> None:
    with controller.open() as lights:
        lights.confirm(None)
        lights.select(1)
        lights.confirm(1)
        for other in (None, 0):
            with pytest.raises(LightControllerError, match="LED 1 is"):
                lights.confirm(other)


def test_silence_puts_the_leds_out(controller: Any) -> None:
    with controller.open(watchdog_ms=150) as lights:
        lights.select(3)
        controller.clock.sleep_s(0.25)
        assert controller.lit() == []
        with pytest.raises(LightControllerError, match="watchdog"):
            lights.confirm(3)


def test_close_puts_the_leds_out_and_the_next_program_can_open_it(controller: Any) -> None:
    for led in (1, 2):
        with controller.open() as lights:
            lights.select(led)
            assert controller.lit() == [led]
        # A socket's last bytes may still be on their way when it has been closed.
        controller.clock.sleep_s(0.02)
        assert controller.lit() == []


def test_one_that_is_unplugged_is_an_error_and_dark(controller: Any) -> None:
    with controller.open() as lights:
        lights.select(1)
        controller.server.stop()
        with pytest.raises(LightControllerError, match=r"gone|hangs"):
            lights.select(2)
    assert controller.lit() == []
