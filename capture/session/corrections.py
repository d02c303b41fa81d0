"""Correct sets, and enter the corrections into the sessions of these sets."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
from pathlib import Path

from capture.sets.archive import JOURNAL
from capture.sets.captured_set import LoadedSet
from capture.sets.metadata import SetMetadata
from capture.sets.ome_tiff import read_header
from classify.base.errors import InputError

from .folder import SETS, SessionFolder, session_folder
from .journal import Description, SetEntry
from .measures import SpecimenReference, measures_of_first


def correct_in_sessions(paths: Iterable[Path], correct: Callable[[], None]) -> None:
    """Correct sets by `correct`, and enter the corrections into the sessions that they belong to.

    If a session is in use, nothing is corrected.
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
            enter_corrections(
                session,
                [
                    (entry, read_header(path)[0])
                    for entry in session.captured()
                    if (path := session.path / str(entry.file)) in files
                ],
            )


def enter_corrections(
    folder: SessionFolder, described_sets: Iterable[tuple[SetEntry, SetMetadata]]
) -> None:
    """Enter the present metadata of captured sets, and judge the changed sets again.

    Another specimen or orientation changes the measures of all sets of the specimens concerned.
    """
    journal, concerned = folder.journal, set[str]()
    for entry, metadata in described_sets:
        changed = entry.model_copy(update={"description": Description.of(metadata)})
        if changed != entry:
            journal = journal.with_entry(changed)
        if (changed.piece, changed.entered_deg) != (entry.piece, entry.entered_deg):
            concerned |= {changed.piece, entry.piece}
    if journal is folder.journal:
        return
    folder.update(journal)
    for piece in concerned:
        for entry in _measured_again(folder.sets_of(piece), folder.path):
            journal = journal.with_entry(entry)
    folder.update(journal)


def _measured_again(entries: Iterable[SetEntry], folder: Path) -> Iterator[SetEntry]:
    """Measure the sets of a specimen against the first of them; a damaged one stays as it is."""
    reference: SpecimenReference | None = None
    for entry in entries:
        try:
            loaded = LoadedSet.of(folder / (entry.file or ""))
            measures = (
                measures_of_first(loaded) if reference is None else reference.measures(loaded)
            )
            if reference is None and entry.piece:
                reference = SpecimenReference(loaded)
        except InputError:
            continue
        yield entry.model_copy(update={"measures": measures})
