"""``ps4rig rig``: its commands are registered here."""

from capture.base.console import command_group

from . import setup, show, timing

__all__ = ["rig_app"]

rig_app = command_group("Set up and check the rig itself, and switch its lights by hand.")
rig_app.command()(setup.init)
rig_app.command()(setup.flash)
rig_app.command()(show.doctor)
rig_app.command()(show.lights)
rig_app.command()(timing.latency)
rig_app.command()(timing.timing)
rig_app.command()(show.preview)
rig_app.command()(setup.simulate)
