"""Correct sets, and enter the corrections into the sessions of these sets."""

from collections.abc import Callable, Iterable
from contextlib import ExitStack
from pathlib import Path

from capture.sets.ome_tiff import read_header

from .folder import JOURNAL, SETS, session_folder


def correct_in_sessions(paths: Iterable[Path], correct: Callable[[], None]) -> None:
    """Correct sets, and enter the corrections into the sessions that they belong to.

    Parameters
    ----------
    paths
        Files of sets, in sessions or anywhere.
    correct
        Writes the corrected sets.

    Raises
    ------
    InputError
        If a session is in use: nothing is corrected then.
    """
    files = {path.resolve() for path in paths}
    homes = {path.parent.parent for path in files if path.parent.name == SETS}
    with ExitStack() as stack:
        sessions = [
            stack.enter_context(session_folder(home))
            for home in sorted(homes)
            if (home / JOURNAL).is_file()
        ]
        correct()
        for session in sessions:
            for planned in session.plan.sets():
                entry = session.journal.entry_of(planned)
                if entry is None or entry.file is None:
                    continue
                path = session.path / entry.file
                if path in files:
                    metadata, _ = read_header(path)
                    session.enter_corrections(planned, metadata)
