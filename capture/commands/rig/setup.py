"""Commands that set a rig up: rig init, rig flash."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from capture.base.console import complain, out, print_json, reported
from capture.base.outputs import check_output
from capture.commands import options


@reported
def init(
    file: Annotated[Path, typer.Argument(help="The file to write.")] = Path("rig.toml"),
    port: Annotated[
        str | None,
        typer.Option(help="Port of the light controller.", show_default="searched", metavar="PORT"),
    ] = None,
    force: options.Force = False,
) -> None:
    """Write a commented rig.toml from the light controllers and cameras that are plugged in.

    Without --port, each serial port of a known board is asked for a light controller. Keys whose
    device is not found are comments that tell how to fill them in.
    """
    from classify.base.durable_file import durable_file
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
    with durable_file(file) as temporary:
        temporary.write_text(initial_config(controllers, cameras), encoding="utf-8")
    out.print(
        f"{file}: light controllers found: {len(controllers)}, cameras found: {len(cameras)}; "
        f"review it, then run ps4rig rig doctor --rig {file}",
    )


@reported
def flash(
    port: Annotated[
        str | None,
        typer.Option(help="Serial port of the board.", show_default="found", metavar="PORT"),
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
