"""``ps4rig rig``: one file per command, registered here."""

from capture.base.console import command_group

from . import doctor, flash, init, latency, lights, preview, simulate, timing

__all__ = ["rig_app"]

rig_app = command_group("Set up and check the rig itself, and switch its lights by hand.")
rig_app.command()(init.init)
rig_app.command()(flash.flash)
rig_app.command()(doctor.doctor)
rig_app.command()(lights.lights)
rig_app.command()(latency.latency)
rig_app.command()(timing.timing)
rig_app.command()(preview.preview)
rig_app.command()(simulate.simulate)
