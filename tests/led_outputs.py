"""The light of the LEDs of a simulated board."""

from firmware_sim import Clock, SimulatedBoard


def settled_outputs(clock: Clock, board: SimulatedBoard) -> list[float]:
    """The output of each LED, 0 to 1, after it has settled."""
    clock.sleep_s(0.02)
    now_s = clock.now_s()
    return [round(board.output(led, now_s), 6) for led in range(board.led_count)]
