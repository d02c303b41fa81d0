"""Commands around a station: station init, doctor, unit, backup, restore."""

from pathlib import Path
from typing import Annotated

import typer

from capture.base.console import complain, out, progress
from capture.base.utc_time import readable_utc
from capture.commands import options

from .rig_show import print_checks


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


def doctor(folder: options.Station, as_json: options.Json = False) -> None:
    """Check everything that a station needs.

    It checks recipe, challenge set, calibration, results, disk and rig; where systemd runs, also
    the unit of the station. The exit status is 1 if there is a fault.
    """
    from capture.station.run.diagnosis import diagnose_station
    from capture.station.service.unit import diagnose_unit

    print_checks([*diagnose_station(folder), *diagnose_unit(folder)], as_json=as_json)


def unit(
    folder: options.Station,
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
    from capture.station.service.unit import Unit, unit_text

    unit_of = {None: Unit.STATION, False: Unit.RUN, True: Unit.PANEL}
    print(unit_text(StationFolder(folder, is_foreign=True), user, unit_of[panel]), end="")


_BackupFile = Annotated[
    Path, typer.Argument(metavar="BACKUP", help="The file, such as line-3.ps4backup.")
]


def backup(folder: options.Station, path: _BackupFile) -> None:
    """Back up a station, also while it runs: results, sets, recipes, settings and users.

    The results are those of one moment, with the set files that they name. The backup holds secrets
    of users: keep it where only you can read it.
    """
    from capture.station.service.backup import prepared_backup

    with prepared_backup(folder, path) as prepared:
        for _ in progress(prepared.write(path), len(prepared.sources), "back up"):
            pass
        for remark in prepared.remarks:
            complain(f"warning: {remark}")
        files = len(prepared.sources)
    out.print(f"{path}: {files} files, {path.stat().st_size / 1e6:.1f} MB")


def restore(
    path: _BackupFile,
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="The folder to make.")],
) -> None:
    """Restore a station from a backup into a new folder; every file is compared with its hash."""
    from capture.station.domain.config import CONFIG
    from capture.station.domain.folder import StationFolder
    from capture.station.results.database import database_url, safe_url
    from capture.station.service.backup import DUMP, opened_backup

    with opened_backup(path) as opened:
        manifest = opened.manifest
        for _ in progress(opened.restore(folder), len(manifest.files), "restore"):
            pass
    out.print(
        f"{folder}: station {manifest.station} of {readable_utc(manifest.utc)}: "
        f"{manifest.parts} parts, {manifest.sets} sets",
    )
    configured = StationFolder(folder).config.results
    if manifest.database == DUMP:
        out.print(
            f"its results are not in the database yet: make an empty one, run pg_restore "
            f"--dbname=NAME {folder / DUMP}, and name it in {folder / CONFIG}",
        )
    elif manifest.database not in (None, configured):
        out.print(
            f"its results are in {folder / manifest.database}, but {folder / CONFIG} names "
            f"{safe_url(database_url(configured))}: change one of them",
        )
