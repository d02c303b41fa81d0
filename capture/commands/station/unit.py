"""``ps4rig station unit``."""

from typing import Annotated

import typer

from capture.base.console import reported

from .teach import Station


@reported
def unit(
    folder: Station,
    user: Annotated[
        str, typer.Option(help="The user that the station runs as.", metavar="NAME")
    ] = "ps4rig",
    panel: Annotated[
        bool | None,
        typer.Option(
            "--panel/--no-panel",
            help="The unit of the panel alone, or of a run without it.",
            show_default="a run with its panel",
        ),
    ] = None,
) -> None:
    """Print the systemd unit of a station, with the commands that install it as comments."""
    from capture.station.domain.folder import StationFolder
    from capture.station.service.unit import unit_text

    print(unit_text(StationFolder(folder), user, panel), end="")
