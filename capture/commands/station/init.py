"""``ps4rig station init``."""

from pathlib import Path
from typing import Annotated

import typer

from capture.base.console import out, reported


@reported
def init(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="The folder to make.")],
) -> None:
    """Make the folder of a station with a commented configuration."""
    from capture.station.domain.folder import make_station

    make_station(folder)
    out.print(
        f"{folder}: edit station.toml, then capture parts with ps4rig station run {folder} "
        f"--collect and teach them in the panel, or run ps4rig station teach {folder} SET...",
    )
