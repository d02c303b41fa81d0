"""`python -m firmware_sim` in its own process."""

import re
import signal
import socket
import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest
import serial

ROOT = Path(__file__).parents[2]


def start(*options: str, **settings: object) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "firmware_sim", *options],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        **settings,
    )


def identity(address: str) -> bytes:
    with serial.serial_for_url(address, timeout=60.0) as port:
        port.write(b"*IDN?\n")
        return port.read_until(b"\n")


@pytest.mark.parametrize(
    ("options", "end"), [(["--pty", "{link}"], signal.SIGINT), (["--tcp"], signal.SIGTERM)]
)
def test_the_command_serves_until_a_signal(tmp_path, options, end):
    link = tmp_path / "port"
    options = [option.format(link=link) for option in options]
    with start(*options, "--serial-number", "SIM-7", "--rise-ms", "0") as process:
        line = process.stdout.readline()
        assert line.startswith("simulated LED controller SIM-7: ")
        address = re.search(r"socket://[\d.:]+|/\S+port", line).group()
        assert identity(address) == b"OK PS4RIG,LED4,SIM-7,2.1.0,2\n"
        process.send_signal(end)
        out, err = process.communicate(timeout=120)
    assert (process.returncode, out, err) == (0, "", "")
    assert not link.is_symlink()


def test_a_system_without_a_free_terminal_is_one_error():
    script = (
        "import sys; from firmware_sim import __main__ as command, terminals\n"
        "terminals.openpty = lambda: open('/dev/none')\n"
        "sys.exit(command.main([]))"
    )
    done = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 2
    assert "pseudo-terminal: No such file" in done.stderr


def test_the_command_ignores_a_hangup_under_nohup():
    ignore_hangup = partial(signal.signal, signal.SIGHUP, signal.SIG_IGN)
    with start("--tcp", preexec_fn=ignore_hangup) as process:
        address = re.search(r"socket://[\d.:]+", process.stdout.readline()).group()
        process.send_signal(signal.SIGHUP)
        assert identity(address).startswith(b"OK PS4RIG")
        process.send_signal(signal.SIGQUIT)
        assert process.wait() == 0


def test_bad_options_and_addresses_in_use_are_refused(tmp_path):
    taken = tmp_path / "taken"
    taken.touch()
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = str(other.getsockname()[1])
        cases = {
            ("--rise-ms", "-1"): "rise_ms is -1.0",
            ("--fall-ms", "soon"): "invalid float value: 'soon'",
            ("--serial-number", "a,b"): "serial number 'a,b'",
            ("--tcp", "65536"): "'65536' is not a port",
            ("--tcp", "1", "--pty"): "not allowed with",
            ("--tcp", port): f"cannot serve at port {port}: Address already in use",
            ("--unix", str(taken)): f"cannot serve at {taken}: Address already in use",
            ("--pty", str(taken)): f"cannot serve at {taken}: File exists",
        }
        # All at once, because starting Python takes most of the time.
        processes = {options: start(*options) for options in cases}
        for options, cause in cases.items():
            with processes[options] as process:
                out, err = process.communicate(timeout=120)
            assert (process.returncode, out) == (2, ""), options
            assert cause in err
            assert len(err.splitlines()) == 1
