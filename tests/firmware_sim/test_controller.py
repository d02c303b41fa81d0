"""The device as a whole: boot, reset on opening, delay of a line."""

BANNER = b"READY PS4RIG,LED4,SIM-0001,2.1.0,2\n"


def test_each_line_costs_its_delay_before_it_is_executed(new_device):
    device = new_device(link_delay_ms=2.5)
    assert device.exchange(b"LED:SEL 0\nLED:SEL 1\n") == b"OK 0,2500\nOK 1,5000\n"
    assert device.exchange(b"LED:") == b""
    assert device.clock.now_s() == 0.005
    assert device.exchange(b"OFF\n") == b"OK -1,7500\n"


def test_opening_a_device_that_does_not_reset(device):
    device.exchange(b"LED:SEL 1\nLED:LEV 1,50\n")
    device.controller.feed(b"*IDN?\n")
    device.controller.connect()
    assert device.controller.take_output() == b"", "sent before the host connected"
    assert device.exchange(b"LED:STAT?\n") == b"OK 1,100,50,100,100,4000\n"


def test_opening_a_device_that_resets(new_device):
    device = new_device(resets_on_open=True, boot_ms=300.0)
    device.exchange(b"LED:SEL 1\nLED:LE")
    device.controller.connect()
    assert device.controller.boot_remaining_s == 0.3
    assert device.lit() == [0.0] * 4
    assert device.exchange(b"*IDN?\n") == b"", "a board that boots receives nothing"
    device.clock.sleep_s(device.controller.boot_remaining_s - 0.001)
    assert device.controller.take_output() == b""
    device.clock.sleep_s(0.001)
    assert device.controller.take_output() == BANNER
    assert device.controller.boot_remaining_s == 0.0
    assert device.exchange(b"LED:STAT?\n") == b"OK -1,100,100,100,100,301000\n"


def test_watchdog_time_counts_from_the_boot(new_device):
    device = new_device(link_delay_ms=0.0)
    device.clock.sleep_s(60.0)
    device.controller.reset()
    device.clock.sleep_s(0.3)
    assert device.controller.take_output() == BANNER
    device.exchange(b"LED:SEL 1\n")
    device.clock.sleep_s(4.999)
    assert device.board.output(1, device.clock.now_s()) > 0.99
    device.clock.sleep_s(0.1)
    assert device.board.output(1, device.clock.now_s()) < 1e-6
