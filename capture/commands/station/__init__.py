"""``ps4rig station``: its commands are registered here."""

from capture.base.console import command_group
from capture.station.domain.own_folder import make_files_private

from . import challenge, gauge, history, panel, run, teach, upkeep, user

__all__ = ["station_app"]

station_app = command_group(
    "Inspect parts with a rig, one after the other, and keep every result.", make_files_private
)
station_app.command()(upkeep.init)
station_app.command()(teach.teach)
station_app.command()(teach.approve)
station_app.command()(teach.roll_back)
station_app.command()(challenge.challenge)
station_app.command()(run.run)
station_app.command()(panel.panel)
station_app.command()(history.history)
station_app.command()(history.override)
station_app.command()(gauge.gauge)
station_app.command()(gauge.bench)
station_app.command()(upkeep.doctor)
station_app.command()(upkeep.unit)
station_app.command()(upkeep.backup)
station_app.command()(upkeep.restore)
station_app.add_typer(user.user_app, name="user")
station_app.add_typer(user.token_app, name="token")
