"""The LED controller's firmware, and a simulated device that runs it.

`firmware` is the program of the real controller, one file for MicroPython and CPython. The rest
simulates the hardware around it: `SimulatedBoard` (LEDs that rise and fall over time), `RealClock`
and `VirtualClock`, `SimulatedController` (firmware, board, boot and line delay as one device), and
`serve_pty`, `serve_unix`, `serve_tcp`, `serve_tty`, which give that device an address.
`serve_local` takes a pseudo-terminal, or a TCP port where there is none. Only the serial number,
``SIM-0001`` by default, tells a host that the device is simulated.

    clock = VirtualClock()
    board = SimulatedBoard(clock)
    with serve_pty(SimulatedController(board, clock)) as server:
        ...  # open server.address as a serial port; `board` gives the light of an exposure

README.md describes the protocol. `python -m firmware_sim` serves a device to type at.
"""

from .board import SimulatedBoard
from .clock import Clock, RealClock, VirtualClock
from .controller import SimulatedController
from .firmware import crc8
from .server import Server, serve_local, serve_pty, serve_tcp, serve_tty, serve_unix

__all__ = [
    "Clock",
    "RealClock",
    "Server",
    "SimulatedBoard",
    "SimulatedController",
    "VirtualClock",
    "crc8",
    "serve_local",
    "serve_pty",
    "serve_tcp",
    "serve_tty",
    "serve_unix",
]
