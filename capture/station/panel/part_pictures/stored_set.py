"""Find the stored set of a part, or say why it is missing."""

from pathlib import Path

from capture.station.domain.folder import StationFolder
from capture.station.panel.security import Denied
from capture.station.results.history import HistoryEntry


def stored_set(folder: StationFolder, entry: HistoryEntry) -> Path:
    """Return the set file of a part."""
    result = entry.result
    if result.set_file is None:
        raise Denied(404, f"part {result.part_id}: no set was captured")
    path = (folder.path / result.set_file).resolve()
    if not path.is_relative_to(folder.parts.resolve()) or not path.is_file():
        when = entry.set_removed_utc
        reason = f"was removed by the retention on {when[:10]}" if when else "is missing"
        raise Denied(410 if when else 404, f"part {result.part_id}: its set file {reason}")
    return path
