"""``ps4rig calibrate``: one file per command, registered here; `flow` is what they share."""

import typer

from . import dark, lights, plate, response, scale, show

__all__ = ["calibrate_app"]

calibrate_app = typer.Typer()
calibrate_app.command()(dark.dark)
calibrate_app.command()(lights.lights)
calibrate_app.command()(plate.plate)
calibrate_app.command()(response.response)
calibrate_app.command()(scale.scale)
calibrate_app.command()(show.show)


@calibrate_app.callback(invoke_without_command=True)
def _options(context: typer.Context) -> None:
    """Measure a rig with a white sheet, a sphere or a checkerboard, and keep it in one file."""
    if context.invoked_subcommand is None:
        print(context.get_help())
