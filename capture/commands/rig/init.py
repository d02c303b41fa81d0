"""``ps4rig rig init``."""

from pathlib import Path
from typing import Annotated

import typer

from capture.base.console import complain, out, reported
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
