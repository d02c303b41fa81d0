"""``ps4rig station backup`` and ``ps4rig station restore``."""

from pathlib import Path
from typing import Annotated

import typer

from capture.base.console import complain, out, progress, reported
from capture.base.utc_time import readable_utc

from .teach import Station

BackupFile = Annotated[
    Path, typer.Argument(metavar="BACKUP", help="The file, such as line-3.ps4backup.")
]


@reported
def backup(folder: Station, path: BackupFile) -> None:
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


@reported
def restore(
    path: BackupFile,
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="The folder to make.")],
) -> None:
    """Restore a station from a backup into a new folder; every file is compared with its hash."""
    from capture.station.domain.config import CONFIG
    from capture.station.domain.folder import StationFolder
    from capture.station.service.backup import DUMP
    from capture.station.service.restore import opened_backup

    with opened_backup(path) as opened:
        manifest = opened.manifest
        for _ in progress(opened.restore(folder), len(manifest.files), "restore"):
            pass
    out.print(
        f"{folder}: station {manifest.station} of {readable_utc(manifest.utc)}: "
        f"{manifest.parts} parts, {manifest.sets} sets",
    )
    named = StationFolder(folder).config.results
    if manifest.database == DUMP:
        out.print(
            f"its results are not in the database yet: make an empty one, run pg_restore "
            f"--dbname=NAME {folder / DUMP}, and name it in {folder / CONFIG}",
        )
    elif manifest.database not in (None, named):
        out.print(
            f"its results are in {folder / manifest.database}, but {folder / CONFIG} names "
            f"{named}: change one of them",
        )
