"""A folder in memory for studies in which durability is not the subject."""

from pathlib import Path
from shutil import disk_usage

from tests.capture.station.teaching_sets import SIDE_PX


def in_memory(parts: int) -> str | None:
    """Return a folder in memory with room for the sets of so many parts, or None.

    Where durability is not the subject, the time of fsync need not be spent.
    """
    shared = Path("/dev/shm")
    needed_bytes = parts * 2 * SIDE_PX * SIDE_PX * 6
    return str(shared) if shared.is_dir() and disk_usage(shared).free > needed_bytes else None
