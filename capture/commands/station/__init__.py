"""``ps4rig station``: one file for each command, registered here."""

from capture.base.console import command_group

from . import (
    backup,
    bench,
    challenge,
    doctor,
    gauge,
    history,
    init,
    panel,
    run,
    teach,
    unit,
    user,
)

__all__ = ["station_app"]

station_app = command_group("Inspect parts with a rig, one after the other, and keep every result.")
station_app.command()(init.init)
station_app.command()(teach.teach)
station_app.command()(teach.approve)
station_app.command()(teach.roll_back)
station_app.command()(challenge.challenge)
station_app.command()(run.run)
station_app.command()(panel.panel)
station_app.command()(history.history)
station_app.command()(history.override)
station_app.command()(gauge.gauge)
station_app.command()(bench.bench)
station_app.command()(doctor.doctor)
station_app.command()(unit.unit)
station_app.command()(backup.backup)
station_app.command()(backup.restore)
station_app.add_typer(user.user_app, name="user")
station_app.add_typer(user.token_app, name="token")
