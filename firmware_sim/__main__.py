"""`python -m firmware_sim`: serve a simulated LED controller until it is interrupted."""

import argparse
import signal
import sys
from collections.abc import Sequence
from typing import NoReturn

from .board import SimulatedBoard
from .clock import RealClock
from .controller import SimulatedController
from .server import Server, serve_pty, serve_tcp, serve_unix

_USAGE_ERROR = 2
_END_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)


def main(arguments: Sequence[str] | None = None) -> int:
    """Serve until a signal that ends programs; return the exit status."""
    options = _parser().parse_args(arguments)
    clock = RealClock()
    # sigwait would return signals that the parent process ignores, such as SIGHUP under nohup.
    end_signals = [s for s in _END_SIGNALS if signal.getsignal(s) != signal.SIG_IGN]
    # The signals are blocked before the server's thread starts, so that only sigwait takes them.
    signal.pthread_sigmask(signal.SIG_BLOCK, end_signals)
    try:
        board = SimulatedBoard(
            clock,
            serial_number=options.serial_number,
            rise_ms=options.rise_ms,
            fall_ms=options.fall_ms,
        )
        controller = SimulatedController(board, clock, resets_on_open=options.resets_on_open)
        server, address = _serve(controller, options)
    except ValueError as error:
        return _fail(str(error))
    except OSError as error:
        where = options.unix or options.pty or "a pseudo-terminal"
        if options.tcp is not None:
            where = f"port {options.tcp}"
        return _fail(f"cannot serve at {where}: {error.strerror or error}")
    with server:
        print(f"simulated LED controller {board.serial_number}: {address}", flush=True)
        signal.sigwait(end_signals)
    return 0


def _serve(controller: SimulatedController, options: argparse.Namespace) -> tuple[Server, str]:
    """Return the server of the options, and its address with a command to try."""
    if options.unix is not None:
        server = serve_unix(controller, options.unix)
        return server, f"unix socket {server.address}, try: socat - UNIX-CONNECT:{server.address}"
    if options.tcp is not None:
        server = serve_tcp(controller, options.tcp)
        return server, f"{server.address}, try: pyserial-miniterm --echo {server.address}"
    server = serve_pty(controller, options.pty or None)
    port = options.pty or server.address
    return server, f"serial port {port}, try: pyserial-miniterm --echo {port}"


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:  # without the usage
        sys.exit(_fail(message))


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="python -m firmware_sim",
        description="Serve a simulated LED controller, by default on a new pseudo-terminal.",
    )
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--pty",
        nargs="?",
        const="",
        metavar="LINK",
        help="pseudo-terminal; LINK becomes a link to it",
    )
    where.add_argument("--unix", metavar="PATH", help="unix socket")
    where.add_argument(
        "--tcp", nargs="?", type=_port, const=0, metavar="PORT", help="TCP port on 127.0.0.1"
    )
    parser.add_argument(
        "--serial-number",
        default="SIM-0001",
        metavar="S",
        help="serial number that the board reports (%(default)s)",
    )
    parser.add_argument(
        "--rise-ms", type=float, default=0.5, metavar="X", help="10-90 %% rise time (%(default)s)"
    )
    parser.add_argument(
        "--fall-ms", type=float, default=0.3, metavar="X", help="90-10 %% fall time (%(default)s)"
    )
    parser.add_argument(
        "--resets-on-open", action="store_true", help="opening the port resets the board"
    )
    return parser


def _port(text: str) -> int:
    if not (text.isdecimal() and int(text) <= 65535):
        raise argparse.ArgumentTypeError(f"{text!r} is not a port, 0 to 65535")
    return int(text)


def _fail(message: str) -> int:
    print(f"python -m firmware_sim: {message}", file=sys.stderr)
    return _USAGE_ERROR


if __name__ == "__main__":
    sys.exit(main())
