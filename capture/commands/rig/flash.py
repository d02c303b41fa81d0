"""``ps4rig rig flash``."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated

import typer

from capture.base.console import out, print_json, reported
from capture.commands import options


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
