"""The LED controller on a Raspberry Pi Pico: MicroPython runs this file at power-up.

It ends at MicroPython's prompt with the LEDs off, where `ps4rig rig flash` can work, if SERVICE_PIN
is low at power-up, after the command SYST:PROG, or if the files on the board cannot be loaded.
"""

import gc
import os
from time import sleep_ms  # type: ignore[attr-defined]

import machine
import micropython
from firmware import Firmware
from pico_board import PicoBoard, darken

SERVICE_PIN = 8
_PROMPT_ONCE = "prompt-once"  # while this file exists, the next boot does not run the program
_WATCHDOG_MS = 3000  # twice the longest pass, which a host that stops reading causes
_PASSES_PER_COLLECTION = 500  # every 25 to 100 ms, as a pass takes 50 to 200 us


def _wants_prompt() -> bool:
    """Whether this boot should end at the prompt; removes the file that asks for it."""
    if not machine.Pin(SERVICE_PIN, machine.Pin.IN, machine.Pin.PULL_UP).value():
        return True
    try:
        os.remove(_PROMPT_ONCE)
    except OSError:
        return False
    return True


def run(firmware: Firmware) -> None:
    """Run the firmware until it is stopped; a pass that hangs resets the board."""
    micropython.kbd_intr(-1)  # Ctrl-C is data like every byte
    watchdog = machine.WDT(timeout=_WATCHDOG_MS)
    passes = 0
    while not firmware.stopped:
        firmware.poll()
        watchdog.feed()
        passes += 1
        # Here, because a collection that MicroPython starts by itself could delay a sequence.
        if passes >= _PASSES_PER_COLLECTION and not firmware.sequence.running:
            gc.collect()
            passes = 0


def main() -> None:
    darken()
    if _wants_prompt():
        return
    board = PicoBoard()
    firmware = Firmware(board)
    try:
        run(firmware)
        with open(_PROMPT_ONCE, "w"):
            pass
    except Exception as error:
        darken()
        board.write(b"FAULT " + repr(error).encode()[:100] + b"\n")
    darken()
    sleep_ms(100)  # until the last line is sent
    machine.reset()  # nothing else stops the watchdog


if __name__ == "__main__":
    main()
