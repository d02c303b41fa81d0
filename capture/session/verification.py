"""Verify the files of a folder: hashes, schema, calibration, journal."""

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

from capture.base.names import SET_SUFFIX
from capture.calibration.ps4cal import SUFFIX as CALIBRATION_SUFFIX
from capture.calibration.ps4cal import CalibrationFile
from capture.sets.archive import JOURNAL, is_set_aside
from capture.sets.captured_set import CapturedSet, calibration_of
from capture.sets.ome_tiff import read_header
from classify import DefectModel, InputError, TextureLibrary
from classify.defects.defect_model import SUFFIX as DEFECTS_SUFFIX
from classify.library.ps4lib import SUFFIX as LIBRARY_SUFFIX
from classify.pieces.piece_model import SUFFIX as PIECES_SUFFIX
from classify.pieces.piece_model import PieceModel
from rig.set_file import OtherVersionError

from .folder import SETS, SessionFolder

_State = Literal[
    "good",
    "missing",
    "altered",
    "other version",
    "without calibration",
    "not in journal",
    "not in results",
]
_READERS: dict[str, Callable[[Path], object]] = {
    # Arrays are read, not mapped, because only then they are compared with their checksums.
    LIBRARY_SUFFIX: partial(TextureLibrary.load, map_from_bytes=sys.maxsize),
    DEFECTS_SUFFIX: DefectModel.load,
    PIECES_SUFFIX: PieceModel.load,
    CALIBRATION_SUFFIX: CalibrationFile.read,
}
_SUFFIXES = (SET_SUFFIX, *_READERS)


@dataclass(frozen=True)
class FileFinding:
    """The state of a file; `details` is empty for a good file."""

    path: Path
    state: _State
    details: str = ""


def files_below(folder: Path, *names: str) -> list[Path]:
    """Return sets, models, libraries, calibrations, journals and files of `names`, sorted."""
    if not folder.is_dir():
        cause = "is a file; give its folder" if folder.exists() else "no such folder"
        raise InputError(f"{folder}: {cause}")
    files = sorted(
        path
        for path in folder.rglob("*")
        if (path.name.endswith(_SUFFIXES) or path.name in (JOURNAL, *names))
        and not is_set_aside(path)
        and not path.is_dir()
        and not path.name.startswith(".")
    )
    if not files:
        raise InputError(
            f"{folder}: holds no captured sets, libraries, calibrations, sessions or stations"
        )
    return files


def verify_file(path: Path) -> Iterator[FileFinding]:
    """Read a file and check its hashes; for a journal, check the set files that it names."""
    try:
        if path.name == JOURNAL:
            yield from _session(path.parent)
        elif path.name.endswith(SET_SUFFIX):
            yield _captured_set(path)
        else:
            _READERS[path.suffix](path)
            yield FileFinding(path, "good")
    except InputError as error:
        yield FileFinding(path, "altered", str(error).removeprefix(f"{path}: "))


def _captured_set(path: Path) -> FileFinding:
    try:
        captured = CapturedSet.load(path)
    except OtherVersionError as error:
        return FileFinding(path, "other version", str(error).removeprefix(f"{path}: "))
    try:
        calibration_of(path, captured.metadata, captured.images.shape[1:])
    except InputError as error:
        return FileFinding(path, "without calibration", str(error).removeprefix(f"{path}: "))
    return FileFinding(path, "good")


def _session(folder: Path) -> Iterator[FileFinding]:
    session = SessionFolder(folder)
    entered = {folder / entry.file: entry for entry in session.journal.entries if entry.file}
    for path, entry in entered.items():
        if not path.is_file():
            yield FileFinding(path, "missing", "it is in the journal of the session")
            continue
        try:
            metadata, _ = read_header(path)
        except InputError:
            continue  # `verify_file` of the set reports it
        if metadata.pixels_sha256 != entry.pixels_sha256:
            yield FileFinding(path, "altered", "its pixels are not those that the journal names")
    for path in sorted((folder / SETS).glob(f"*{SET_SUFFIX}")):
        if path not in entered:
            yield FileFinding(path, "not in journal", "ps4rig session resume enters or replaces it")
    yield FileFinding(folder / JOURNAL, "good")
