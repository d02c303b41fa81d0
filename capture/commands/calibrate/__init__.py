"""``ps4rig calibrate``: its commands are registered here; `flow` is what they share."""

from capture.base.console import command_group

from . import camera, lights, scale, show

__all__ = ["calibrate_app"]

calibrate_app = command_group(
    "Measure a rig with a white sheet, a sphere or a checkerboard, and keep it in one file."
)
calibrate_app.command()(camera.dark)
calibrate_app.command()(lights.lights)
calibrate_app.command()(lights.plate)
calibrate_app.command()(camera.response)
calibrate_app.command()(scale.scale)
calibrate_app.command()(show.show)
