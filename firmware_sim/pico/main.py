"""The LED controller on a Raspberry Pi Pico: MicroPython runs this file at power-up.

It ends at MicroPython's prompt, with the LEDs off, if SERVICE_PIN is held low at power-up, after
the command SYST:PROG, and if the files on the board cannot be loaded: `ps4rig rig flash` goes on
there.
"""

import gc
import os
from time import sleep_ms  # type: ignore[attr-defined]

import machine
import micropython
from firmware import Firmware
from pico_board import PicoBoard, darken

SERVICE_PIN = 8
PROMPT_ONCE = "prompt-once"  # a file that stands for one boot without the program
WATCHDOG_MS = 3000  # twice the longest wait in a turn, for a host that stops reading
TURNS_PER_COLLECTION = 500


def wants_prompt() -> bool:
    """Whether this boot is to end at the prompt; asked once."""
    if not machine.Pin(SERVICE_PIN, machine.Pin.IN, machine.Pin.PULL_UP).value():
        return True
    try:
        os.remove(PROMPT_ONCE)
    except OSError:
        return False
    return True


def run(firmware: Firmware) -> None:
    """Run the firmware until it is stopped; a turn that hangs resets the board."""
    micropython.kbd_intr(-1)  # bytes are data, Ctrl-C too
    watchdog = machine.WDT(timeout=WATCHDOG_MS)
    turns = 0
    while not firmware.stopped:
        firmware.poll()
        watchdog.feed()
        turns += 1
        # when it does no harm: one that MicroPython begins by itself could make a sequence late
        if turns >= TURNS_PER_COLLECTION and not firmware.sequence.running:
            gc.collect()
            turns = 0


def main() -> None:
    darken()
    if wants_prompt():
        return
    board = PicoBoard()
    firmware = Firmware(board)
    try:
        run(firmware)
        with open(PROMPT_ONCE, "w"):
            pass
    except Exception as error:
        darken()
        board.write(b"FAULT " + repr(error).encode()[:100] + b"\n")
    darken()
    sleep_ms(100)  # for the last line to leave
    machine.reset()  # stops the watchdog as well, which nothing else can


if __name__ == "__main__":
    main()
