"""``ps4rig calibrate``: one file per command, registered here; `flow` is what they share."""

from capture.base.console import command_group

from . import dark, lights, plate, response, scale, show

__all__ = ["calibrate_app"]

calibrate_app = command_group(
    "Measure a rig with a white sheet, a sphere or a checkerboard, and keep it in one file."
)
calibrate_app.command()(dark.dark)
calibrate_app.command()(lights.lights)
calibrate_app.command()(plate.plate)
calibrate_app.command()(response.response)
calibrate_app.command()(scale.scale)
calibrate_app.command()(show.show)
