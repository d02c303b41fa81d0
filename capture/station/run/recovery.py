"""Recovery after a killed run: begun parts without a result, damaged or unknown set files."""

from collections.abc import Callable, Iterator
from itertools import islice
from pathlib import Path
from typing import Any

from capture.base.names import SET_SUFFIX
from capture.sets.captured_set import CapturedSet
from capture.station.domain.config import CONFIG
from capture.station.domain.folder import PARTS, StationFolder, set_file_of
from capture.station.domain.verdict import Cause, Decision, Verdict
from capture.station.results.part_result import PartResult
from capture.station.results.store import BegunPart, ResultStore
from classify.base.errors import InputError

from .outcome import SOFTWARE_VERSION

# Number of last results whose set files are read again at the start. A loss of power can damage
# files of the last seconds.
_LAST_RESULTS = 10
_FILES_AT_A_TIME = 500


def finish_interrupted(
    folder: Path, store: ResultStore, decided_utc: Callable[[], str]
) -> Iterator[PartResult]:
    """Give each begun part without a result the verdict ERROR, and yield it with its intact set."""
    for part in store.unfinished():
        set_fields, reason = _interrupted_set(folder, part)
        result = PartResult(
            station=store.station,
            exposed_utc=None,
            decided_utc=decided_utc(),
            operator=None,
            software_version=SOFTWARE_VERSION,
            verdict=Verdict(Decision.ERROR, reason, (Cause.INTERRUPTED,)),
            **vars(part),
            **set_fields,
        )
        yield store.add(result)


def _interrupted_set(folder: Path, part: BegunPart) -> tuple[dict[str, Any], str]:
    """Fields that name the set of an interrupted part, and the reason of its verdict."""
    set_file = set_file_of(part.part_id, part.triggered_utc)
    reason = "the station was interrupted before the verdict"
    if not (folder / set_file).exists():
        return {}, f"{reason}; no set was saved"
    try:
        captured = CapturedSet.load(folder / set_file)
    except InputError as error:
        return {}, f"{reason}; its set file is damaged: {error}"
    sha256 = captured.metadata.pixels_sha256
    return {"set_file": set_file, "set_sha256": sha256}, f"{reason}; its set was saved"


def damaged_sets(folder: Path, store: ResultStore) -> Iterator[str]:
    """Yield a line for each set file of the last results that is missing or altered."""
    for entry in store.parts(newest=_LAST_RESULTS):
        result = entry.result
        if result.set_file is None or entry.set_removed_utc is not None:
            continue
        part = f"part {result.part_id}, {result.verdict.decision}"
        if not (folder / result.set_file).exists():
            yield f"{part}: its set file {result.set_file} is missing"
            continue
        try:
            captured = CapturedSet.load(folder / result.set_file)
        except InputError as error:
            yield f"{part}: its set file is damaged: {error}"
            continue
        if captured.metadata.pixels_sha256 != result.set_sha256:
            yield f"{part}: {result.set_file} is not the set that was judged"


def require_own_sets(folder: StationFolder, store: ResultStore) -> None:
    """Refuse sets that are not in the results: new parts begin at 1, with the ids of old ones."""
    if store.last_number() == 0 and folder.has_sets():
        raise InputError(
            f"{folder.parts}: holds sets, and the results have no part of a station {store.station}"
            f"; give name = in {CONFIG} its earlier value again, or move {folder.parts} elsewhere"
        )


def unknown_files(folder: Path, store: ResultStore) -> Iterator[str]:
    """Yield a line for each set file whose part is not in the results."""
    names = iter(sorted((folder / PARTS).glob(f"*/*{SET_SUFFIX}")))
    while batch := list(islice(names, _FILES_AT_A_TIME)):
        path_of = {path.name.removesuffix(SET_SUFFIX): path for path in batch}
        for part_id in sorted(path_of.keys() - store.known_ids(path_of)):
            path = path_of[part_id].relative_to(folder)
            yield f"{path}: no part of the results; keep it elsewhere, or restore the database"
