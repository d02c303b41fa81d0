"""Commands that set a rig up: rig init, rig flash, rig simulate."""

from __future__ import annotations

import sys
import time
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from capture.base.console import complain, out, print_json
from capture.base.outputs import check_output
from capture.commands import options
from classify.base.errors import InputError

if TYPE_CHECKING:
    from rig.simulation.devices import DeviceSimulation


def init(
    file: Annotated[Path, typer.Argument(help="The file to write.")] = Path("rig.toml"),
    port: Annotated[
        str | None,
        typer.Option(
            "--port", help="Port of the light controller.", show_default="searched", metavar="PORT"
        ),
    ] = None,
    force: options.Force = False,
) -> None:
    """Write a commented rig.toml from the light controllers and cameras that are plugged in.

    Without --port, each serial port of a known board is asked for a light controller. Keys whose
    device is not found are comments that tell how to fill them in.
    """
    from classify.base.durable_file import write_text
    from rig import LightControllerError, list_cameras
    from rig.initial_config import answering_controllers, initial_config
    from rig.lights.discovery import SerialPort, identify, list_serial_ports

    check_output(file, suffix=".toml", force=force)
    if port is None:
        boards = [board for board in list_serial_ports() if board.may_be_a_microcontroller]
        controllers = answering_controllers(boards)
    else:
        try:
            controllers = [(SerialPort(port), identify(port))]
        except LightControllerError as error:
            complain(f"warning: {error}")
            controllers = []
    cameras = list_cameras()
    write_text(file, initial_config(controllers, cameras))
    out.print(
        f"{file}: light controllers found: {len(controllers)}, cameras found: {len(cameras)}; "
        f"review it, then run ps4rig rig doctor --rig {file}",
    )


def flash(
    port: Annotated[
        str | None,
        typer.Option(
            "--port", help="Serial port of the board.", show_default="found", metavar="PORT"
        ),
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Print the files and the board, and change nothing.")
    ] = False,
    as_json: options.Json = False,
) -> None:
    """Put the firmware on a Raspberry Pi Pico that runs MicroPython.

    The LEDs go out, the files are copied and read back, and the board starts with them. A board
    that another program uses is refused.
    """
    from rig.lights.discovery import list_serial_ports
    from rig.lights.flash import board_files, find_board, flash_port, sha256

    files = board_files()
    flashed = flash_port(port or find_board(list_serial_ports()), files, dry_run=dry_run)
    listed = [
        {"name": file.name, "bytes": file.stat().st_size, "sha256": sha256(file)} for file in files
    ]
    if as_json:
        print_json({**asdict(flashed), "files": listed, "dry_run": dry_run})
        return
    for file in listed:
        out.print("{name}: {bytes} bytes, SHA-256 {sha256:.16}".format_map(file))
    verb = "would get" if dry_run else "has"
    out.print(
        f"{flashed.port} {verb} firmware {flashed.new}; before: {flashed.before or 'none'}",
    )


_REPORT_EVERY_S = 5.0


def simulate(
    rig: options.Rig = "sim",
    serial: Annotated[
        str | None,
        typer.Option(
            help="Serial device on which the firmware answers: this machine's end of a USB gadget "
            "or of a null modem. Without it a pseudo-terminal is made.",
            metavar="DEV",
        ),
    ] = None,
    camera: Annotated[
        str | None,
        typer.Option(
            help="Kind and place of the camera that is served, such as v4l2:/dev/video9. "
            "Without --serial and --camera the choices are listed.",
            metavar="KIND:PLACE",
        ),
    ] = None,
    surface: options.Surface = None,
    rotate: Annotated[
        float | None,
        typer.Option(
            help="Orientation of the surface in degrees, anticlockwise.",
            rich_help_panel=options.SIMULATION,
            metavar="DEG",
        ),
    ] = None,
    slant: options.Slant = None,
    shift_px: options.ShiftPx = None,
    seed: options.Seed = None,
    bits: options.Bits = None,
    size: options.Size = None,
) -> None:
    """Simulate a rig as devices: the firmware on a serial line, and a camera.

    Runs until Ctrl-C. Only the controller's serial number, SIM-0001, distinguishes it from a real
    one; sets that ps4rig captures from it are marked as simulated.
    """
    from rig.config.rig import config_of
    from rig.simulation.devices import DeviceSimulation, camera_choices

    if serial is None and camera is None:
        raise InputError(
            "give --serial DEV, where the firmware answers, or for the frames --camera "
            f"{camera_choices()}"
        )
    placement = {"surface": surface, "rotate_deg": rotate, "shift_px": shift_px, "seed": seed}
    config = options.with_simulation(config_of(rig), placement, slant, bits, size)

    simulation = DeviceSimulation(config, serial=serial, served=camera)
    try:
        out.print(f"lights: {simulation.port}")
        if simulation.camera is not None:
            settings = config.camera
            out.print(
                f"camera: {camera}, {simulation.camera.pixel_format} "
                f"{settings.width_px}x{settings.height_px}, {settings.frame_rate_hz:g} Hz, "
                f"exposure {settings.exposure_ms:g} ms",
            )
        sys.stdout.flush()
        _run(simulation)
    except KeyboardInterrupt:
        print(_status(simulation), file=sys.stderr)  # Ctrl-C is the normal end
    finally:
        simulation.close()


def _run(simulation: DeviceSimulation) -> None:
    next_report_s = time.monotonic()
    while True:
        simulation.step()
        if sys.stderr.isatty() and time.monotonic() >= next_report_s:
            next_report_s += _REPORT_EVERY_S
            print(_status(simulation), file=sys.stderr)


def _status(simulation: DeviceSimulation) -> str:
    lit = ", ".join(f"LED {led}" for led in simulation.lit) or "no LED"
    if simulation.camera is None:
        return f"{lit} lit"
    return f"{lit} lit, {simulation.written_count} frames written, {simulation.late_count} too late"
