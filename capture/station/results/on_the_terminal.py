"""Changes by commands: whoever may write into the folder of a station may change it."""

import os
from collections.abc import Iterator
from contextlib import closing, contextmanager

from capture.station.domain.folder import StationFolder
from capture.station.domain.roles import Identity, Role
from capture.station.results.results_access import ResultsAccess
from classify.base.errors import InputError

from .audit import ChangeLog

try:
    import pwd
except ImportError:  # Windows
    pwd = None  # type: ignore[assignment]

_LONGEST_NAME = 200  # as in the approval of a recipe


@contextmanager
def changing_on_the_terminal(
    folder: StationFolder, by: str | None = None
) -> Iterator[tuple[ChangeLog, Identity]]:
    """Yield the log of changes, and who changes the station: `by` and the user of the system."""
    if by is not None and not (by.strip() and by.isprintable() and len(by) <= _LONGEST_NAME):
        raise InputError(f"--by {by[:20]!r}: give 1 to {_LONGEST_NAME} printable characters")
    user = system_user()
    name = f"{user}, on the terminal" if by is None else f"{by}, on the terminal as {user}"
    with closing(ResultsAccess(folder)) as results:
        yield ChangeLog(folder, results), Identity(name, Role.ADMINISTRATOR, "local")


def system_user() -> str:
    """Return the user of this process, whatever environment variables such as LOGNAME say."""
    if pwd is None:
        return os.getlogin()
    try:
        return pwd.getpwuid(os.getuid()).pw_name
    except KeyError:  # not in the system's list
        return f"user {os.getuid()}"
