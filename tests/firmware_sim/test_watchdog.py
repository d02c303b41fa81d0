"""The watchdog, exact to the simulated microsecond."""

import pytest

TRIPPED = b'OK 100,"Watchdog: LEDs off"\n'
NO_ERROR = b'OK 0,"No error"\n'


@pytest.fixture
def instant(new_device):
    """A device without line delay, so that time passes only in sleeps."""
    return new_device(link_delay_ms=0.0)


def test_the_watchdog_trips_at_its_time_and_not_before(instant):
    instant.exchange(b"LED:SEL 1\n")
    instant.clock.sleep_s(4.999)
    assert instant.board.output(1, instant.clock.now_s()) == pytest.approx(1.0)
    instant.clock.sleep_s(0.001)
    now_s = instant.clock.now_s()
    assert now_s == 5.0
    assert instant.board.output(1, now_s) == pytest.approx(1.0)  # begins to fall now
    instant.clock.sleep_s(0.003)
    assert instant.board.output(1, now_s + 0.003) < 1e-6
    assert instant.exchange(b"SYST:ERR?\n" * 2) == TRIPPED + NO_ERROR
    assert instant.exchange(b"LED:STAT?\n").startswith(b"OK -1,")


@pytest.mark.parametrize("watchdog_ms", [100, 250, 60000])
def test_the_watchdog_time_can_be_set(instant, watchdog_ms):
    instant.exchange(b"SYST:WDOG %d\nLED:SEL 0\n" % watchdog_ms)
    instant.clock.sleep_s(watchdog_ms / 1000 - 0.001)
    start_s = instant.clock.now_s()
    instant.clock.sleep_s(0.051)
    # 1 ms of full light, then the integral of the fall: 0.3 ms / ln 9.
    light_s = instant.board.output_integral_s(0, start_s, instant.clock.now_s())
    assert light_s == pytest.approx(0.001 + 0.0003 / 2.1972245773362196, rel=1e-9)


def test_any_accepted_command_feeds_the_watchdog(instant):
    instant.exchange(b"LED:SEL 1\n")
    for _ in range(4):
        instant.clock.sleep_s(4.999)
        assert instant.exchange(b"SYST:ERR?\n") == NO_ERROR
    assert instant.exchange(b"LED:STAT?\n").startswith(b"OK 1,")


def test_refused_lines_do_not_feed_the_watchdog(instant):
    instant.exchange(b"LED:SEL 1\n")
    for _ in range(10):
        instant.clock.sleep_s(0.5)
        instant.exchange(b"HELLO\n")
    assert instant.exchange(b"LED:STAT?\n").startswith(b"OK -1,")


def test_the_watchdog_trips_once_and_only_with_an_led_on(instant):
    instant.clock.sleep_s(20.0)
    assert instant.exchange(b"SYST:ERR?\n") == NO_ERROR
    instant.exchange(b"LED:SEL 1\n")
    instant.clock.sleep_s(20.0)
    assert instant.exchange(b"SYST:ERR?\n" * 2) == TRIPPED + NO_ERROR
    instant.exchange(b"LED:SEL 1\nLED:OFF\n")
    instant.clock.sleep_s(20.0)
    assert instant.exchange(b"SYST:ERR?\n") == NO_ERROR
