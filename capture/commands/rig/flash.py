"""``ps4rig rig flash``."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from capture.commands import options
from capture.console import out, print_json, reported

if TYPE_CHECKING:
    from rig.lights.flash import BoardFile, Flashed


@reported
def flash(
    to: Annotated[
        Path | None,
        typer.Option(help="Folder of a MicroPython board that shows as a drive.", metavar="DIR"),
    ] = None,
    port: Annotated[
        str | None,
        typer.Option(help="Serial port of the board.", show_default="found", metavar="PORT"),
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", help="Write into any folder that --to names.")
    ] = False,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Print the files and the board, and change nothing.")
    ] = False,
    as_json: options.Json = False,
) -> None:
    """Put the firmware on a Raspberry Pi Pico that runs MicroPython.

    The LEDs go out, the files are copied and read back, and the board starts with them. A board
    that another program uses is refused.
    """
    from classify.errors import InputError
    from rig.lights.flash import board_files, firmware_version

    if to is not None and port is not None:
        raise InputError("--to and --port are both given; give one of them")
    files = board_files()
    flashed = _flash(files, to, port, force, dry_run)
    new = firmware_version(files[0].data)
    if as_json:
        listed = [
            {"name": file.name, "bytes": len(file.data), "sha256": file.sha256} for file in files
        ]
        print_json({**asdict(flashed), "new": new, "files": listed, "dry_run": dry_run})
        return
    for file in files:
        out.print(f"{file.name}: {len(file.data)} bytes, SHA-256 {file.sha256[:16]}")
    done = "would get" if dry_run else "has"
    out.print(
        f"{flashed.where} {done} firmware {new}; before: {flashed.before or 'none'}", soft_wrap=True
    )


def _flash(
    files: tuple[BoardFile, ...], to: Path | None, port: str | None, force: bool, dry_run: bool
) -> Flashed:
    """Write the files to the drive `to` or the board at `port`, or else to the only one found."""
    from rig.errors import LightControllerError
    from rig.lights.discovery import list_serial_ports
    from rig.lights.flash import find_board, find_drives, flash_folder, flash_port

    if to is None and port is None:
        try:
            port = find_board(list_serial_ports())
        except LightControllerError:
            drives = find_drives()
            if len(drives) != 1:
                raise
            to = drives[0]
    if port is not None:
        return flash_port(port, files, dry_run=dry_run)
    assert to is not None
    return flash_folder(to, files, force=force, dry_run=dry_run)
