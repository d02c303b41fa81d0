"""Back up a running station into one file, with its state at one moment, and restore it."""

import errno
import os
import shutil
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path, PurePosixPath
from typing import Annotated, Literal

from pydantic import AfterValidator, FailFast, Field, ValidationError

from capture.base.folder_lock import LOCK_FILE_SUFFIX
from capture.base.names import SET_SUFFIX
from capture.base.utc_time import utc_text
from capture.station.domain.config import CONFIG, SIM
from capture.station.domain.folder import PARTS, RECIPES, StationFolder
from capture.station.domain.own_folder import SECRETS, SESSIONS, refuse_link
from capture.station.domain.private_file import OWNER_ONLY
from capture.station.results.snapshot import ResultsSnapshot, copy_results
from capture.station.run.retention import inside_parts, sets_stay
from classify.base.durable_file import durable_file, require_folder, sync, temporary_path
from classify.base.errors import InputError
from classify.base.models import Record
from classify.base.regular_file import open_regular_file

_BLOCK_BYTES = 1 << 20
_MAX_FILE_BYTES = 1 << 40
# Files of SQLite beside the database while programs have it open.
_BESIDE_SQLITE = ("", "-wal", "-shm", "-journal")
_LOCKS = (".lock", LOCK_FILE_SUFFIX, f"{LOCK_FILE_SUFFIX}-journal")
DUMP = "results.pgdump"
MANIFEST = "backup.json"
_MAX_FILES = 2_000_000
"""Largest number of files: those of three weeks with a failed part a second. The manifest then has
400 MB."""
_MAX_FOLDERS = 16
"""Largest number of folders inside each other; a station makes five."""
_MAX_BACKUP_BYTES = 1 << 44
_MAX_MANIFEST_BYTES = 1 << 29
# What zipfile and zlib raise for a damaged file; RuntimeError stands for encrypted members.
_UNREADABLE = (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError)


def _inside(text: str) -> str:
    """Check that a name is of a file inside a folder."""
    parts = PurePosixPath(text).parts
    if len(parts) > _MAX_FOLDERS:
        raise ValueError(f"{text[:100]!r} lies in more than {_MAX_FOLDERS} folders")
    if text != "/".join(parts) or parts[:1] == ("/",) or ".." in parts or "\0" in text:
        raise ValueError(f"{text!r} is not the name of a file inside a folder")
    text.encode()  # names that are not UTF-8 raise a ValueError, too
    return text


_InnerPath = Annotated[str, Field(min_length=1, max_length=4096), AfterValidator(_inside)]
_Text = Annotated[str, Field(max_length=200)]
_Count = Annotated[int, Field(ge=0)]


class _StoredFile(Record):
    """A file of a backup."""

    path: _InnerPath
    bytes: _Count
    sha256: str = Field(pattern=r"^[0-9a-f]{64}$")


class _Manifest(Record):
    """The contents of a backup."""

    format: Literal["ps4rig-backup"] = "ps4rig-backup"
    version: Literal[2] = 2
    utc: _Text  # when the results were copied
    station: _Text
    software_version: _Text
    # SQLite file or PostgreSQL dump in the backup; None before the first run.
    database: _InnerPath | None
    parts: _Count  # those with a result
    chain_sha256: _Text  # head of the chain of hashes of the station; empty without rows
    sets: _Count
    # Set files that the results name. The first fault ends the reading of a hostile list.
    missing: Annotated[tuple[_InnerPath, ...], Field(max_length=_MAX_FILES), FailFast()]
    files: Annotated[tuple[_StoredFile, ...], Field(max_length=_MAX_FILES), FailFast()]


class _Backup:
    """A backup that is about to be written; `prepared_backup` makes it."""

    def __init__(
        self,
        station: StationFolder,
        snapshot: ResultsSnapshot,
        database: tuple[str, Path] | None,
    ) -> None:
        folder = station.path
        self._station, self._snapshot, self._database = station, snapshot, database
        self._recipes = _stamps(folder / RECIPES)
        self._utc = utc_text()
        self.sources: dict[str, Path] = dict(_settings(station))
        if database is not None:
            self.sources[database[0]] = database[1]
        self._missing = []
        for name in snapshot.set_files:
            path = inside_parts(name)
            if (folder / path).is_file():
                self.sources[str(path)] = folder / path
            else:
                self._missing.append(name)
        if len(self.sources) > _MAX_FILES:
            raise InputError(
                f"{folder}: has more than {_MAX_FILES} files; move old parts elsewhere"
            )
        self.remarks = tuple(_remarks(station, self._missing))

    def write(self, path: Path) -> Iterator[str]:
        """Write the backup, which appears when it is on disk; yield the name of each file."""
        stored = []
        with durable_file(path) as temporary:
            temporary.chmod(0o600)  # it holds hashes of passwords
            with zipfile.ZipFile(temporary, "w") as archive:
                for name, source in self.sources.items():
                    stored.append(_store(archive, name, source))
                    yield name
                if _stamps(self._station.path / RECIPES) != self._recipes:
                    raise InputError(f"{path}: a recipe was changed meanwhile; repeat the backup")
                manifest = self._manifest(tuple(stored))
                archive.writestr(MANIFEST, manifest.model_dump_json(indent=1))

    def _manifest(self, files: tuple[_StoredFile, ...]) -> _Manifest:
        return _Manifest(
            utc=self._utc,
            station=self._station.config.name,
            software_version=version("ps4rig"),
            database=None if self._database is None else self._database[0],
            parts=self._snapshot.parts,
            chain_sha256=self._snapshot.chain_sha256,
            sets=len(self._snapshot.set_files) - len(self._missing),
            missing=tuple(self._missing),
            files=files,
        )


@contextmanager
def prepared_backup(folder: Path, path: Path) -> Iterator[_Backup]:
    """Copy the results of a station, which may run, and list the files of the backup.

    No set file is removed during the block.
    """
    station = StationFolder(folder)
    _check_place(folder, path)
    results, name = station.results, station.config.name
    with (
        sets_stay(folder),
        # The copy lies beside the backup, whose disk needs the space in any case.
        temporary_path(path.absolute().parent, path) as copy,
    ):
        snapshot, database = ResultsSnapshot(0, (), ""), None
        if "://" in results:
            snapshot, database = copy_results(results, name, copy), (DUMP, copy)
        elif Path(results).exists():
            _check_space(station, path, 2 * Path(results).stat().st_size)
            snapshot = copy_results(results, name, copy)
            database = (_name_of_results(folder, Path(results)), copy)
        backup = _Backup(station, snapshot, database)
        needed_bytes = sum(source.stat().st_size for source in backup.sources.values())
        _check_space(station, path, needed_bytes)
        yield backup


def _check_place(folder: Path, path: Path) -> None:
    require_folder(path)
    if path.exists() or path.is_symlink():
        raise InputError(f"{path}: exists; give another name")
    if path.resolve().is_relative_to(folder.resolve()):
        raise InputError(f"{path}: inside the station, with which it would be lost")


def _name_of_results(folder: Path, results: Path) -> str:
    """Name of the SQLite file in a backup: its own, or a name for one of another folder."""
    if results.resolve().is_relative_to(folder.resolve()):
        return results.resolve().relative_to(folder.resolve()).as_posix()
    return "results.sqlite"


def _settings(station: StationFolder) -> Iterator[tuple[str, Path]]:
    """All files but results, sets of parts and locks, by their name in the backup."""
    results = Path(station.results).resolve()
    left_out = {results.with_name(results.name + end) for end in _BESIDE_SQLITE}
    for path in _files_below(station.path):
        name = path.relative_to(station.path).as_posix()
        try:
            name.encode()
        except UnicodeEncodeError as error:
            raise InputError(f"{str(path)!r}: a name that is not UTF-8; rename it") from error
        is_set = name.startswith(f"{PARTS}/") and name.endswith(SET_SUFFIX)
        is_left_out = path.name.endswith(_LOCKS) or path.resolve() in left_out
        # A restore would begin sessions again that somebody ended.
        if not (is_set or is_left_out or name == SESSIONS):
            yield name, path


def _files_below(folder: Path, folders: int = 1) -> Iterator[Path]:
    """All files but hidden ones, which are being written; links are refused."""
    if folders > _MAX_FOLDERS:
        raise InputError(f"{folder}: lies in more than {_MAX_FOLDERS} folders; move it elsewhere")
    for path in sorted(folder.iterdir()):
        if path.name.startswith("."):
            continue
        refuse_link(path)
        if path.is_dir():
            yield from _files_below(path, folders + 1)
        elif path.is_file():
            yield path


def _stamps(recipes: Path) -> dict[Path, tuple[int, int]]:
    """Stamps that change with each file of the recipes, because these files name each other."""
    stats = {path: path.stat() for path in _files_below(recipes)}
    return {path: (status.st_mtime_ns, status.st_size) for path, status in stats.items()}


def _remarks(station: StationFolder, missing: list[str]) -> Iterator[str]:
    if missing:
        yield f"{len(missing)} set files of the results are missing, the first {missing[0]}"
    used = [station.results] if "://" not in station.results else []
    used += [station.rig] if station.rig != SIM else []
    for text in used:
        if not Path(text).resolve().is_relative_to(station.path.resolve()):
            yield f"{text}: outside the station; see {CONFIG} after a restore"


def _check_space(station: StationFolder, path: Path, needed_bytes: int) -> None:
    """Check that the bytes fit without bringing the station to its disk floor."""
    target_folder = path.absolute().parent
    if target_folder.stat().st_dev == station.path.stat().st_dev:
        needed_bytes += station.config.disk_floor_mb * 1_000_000
    free_bytes = shutil.disk_usage(target_folder).free
    if free_bytes < needed_bytes:
        raise InputError(
            f"{path}: {free_bytes / 1e6:.0f} MB free, {needed_bytes / 1e6:.0f} MB needed with the "
            "station's disk floor; give a place on another disk"
        )


def _store(archive: zipfile.ZipFile, name: str, source: Path) -> _StoredFile:
    """Copy a file into the archive, up to its present size: a log may grow meanwhile."""
    digest = sha256()
    with open_regular_file(source, _MAX_FILE_BYTES) as file:
        status = os.fstat(file.fileno())
        remaining_bytes = status.st_size
        with archive.open(zipfile.ZipInfo(name), "w", force_zip64=True) as member:
            while remaining_bytes and (block := file.read(min(_BLOCK_BYTES, remaining_bytes))):
                digest.update(block)
                member.write(block)
                remaining_bytes -= len(block)
    return _StoredFile(
        path=name,
        bytes=status.st_size - remaining_bytes,
        sha256=digest.hexdigest(),
    )


class _OpenBackup:
    """A backup whose list of files was checked; `opened_backup` makes it."""

    def __init__(self, path: Path, archive: zipfile.ZipFile) -> None:
        self._path, self._archive = path, archive
        self.manifest = self._read_manifest()
        members = sorted(info.filename for info in archive.infolist())
        if members != sorted([MANIFEST, *(file.path for file in self.manifest.files)]):
            raise InputError(f"{path}: damaged: its files are not those of its manifest")

    def restore(self, folder: Path) -> Iterator[str]:
        """Write the station to `folder`, which appears complete; yield the name of each file."""
        folder = folder.absolute()
        is_used = folder.exists() and (not folder.is_dir() or any(folder.iterdir()))
        if folder.is_symlink() or is_used:
            raise InputError(f"{folder}: exists and is not empty; give another folder")
        if not folder.parent.is_dir():
            raise InputError(f"{folder}: cannot be made: there is no folder {folder.parent}")
        needed = sum(file.bytes for file in self.manifest.files)
        free = shutil.disk_usage(folder.parent).free
        if free < needed:
            raise InputError(
                f"{folder}: {free / 1e6:.0f} MB free, {needed / 1e6:.0f} MB needed; make room"
            )
        with temporary_path(folder.parent, folder, is_folder=True) as temporary:
            temporary.chmod(0o750)
            for file in self.manifest.files:
                self._extract(file, temporary)
                yield file.path
            StationFolder(temporary)  # a backup of something else is refused
            for path in temporary.rglob("*"):
                if path.is_dir():
                    sync(path)
            sync(temporary)
            if folder.exists():
                folder.rmdir()  # Windows cannot rename onto a folder
            temporary.rename(folder)
            sync(folder.parent)

    def _read_manifest(self) -> _Manifest:
        with self._readable():
            info = self._archive.getinfo(MANIFEST)
            if info.file_size > _MAX_MANIFEST_BYTES or info.compress_type != zipfile.ZIP_STORED:
                raise InputError(
                    f"{self._path}: no backup of a station: its manifest of {info.file_size} bytes "
                    "is compressed, or too large"
                )
            text = self._archive.read(info)
        try:
            return _Manifest.model_validate_json(text)
        except ValidationError as error:
            first = error.errors()[0]
            place = ".".join(map(str, first["loc"]))
            raise InputError(
                f"{self._path}: its manifest cannot be used: {place}: {first['msg']}"
            ) from error

    def _extract(self, file: _StoredFile, folder: Path) -> None:
        path = folder / file.path
        if not path.resolve().is_relative_to(folder.resolve()):  # a drive, on Windows
            raise InputError(f"{self._path}: {file.path}: names another place on this system")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch(exist_ok=False)
        path.chmod(OWNER_ONLY if path.name in SECRETS else 0o640)
        digest, remaining_bytes = sha256(), file.bytes
        with self._readable(), self._archive.open(file.path) as member, path.open("wb") as target:
            # One byte more is read, to notice a file that is too long.
            while block := member.read(min(_BLOCK_BYTES, remaining_bytes + 1)):
                remaining_bytes -= len(block)
                if remaining_bytes < 0:
                    break
                digest.update(block)
                target.write(block)
        if remaining_bytes != 0 or digest.hexdigest() != file.sha256:
            raise InputError(f"{self._path}: damaged: {file.path} is not the file that was stored")
        sync(path)

    @contextmanager
    def _readable(self) -> Iterator[None]:
        try:
            yield
        except KeyError as error:
            raise InputError(f"{self._path}: not a backup of a station") from error
        except (*_UNREADABLE, OSError) as error:
            # A damaged offset leads to a place before the file; other errors are of the disk.
            if isinstance(error, OSError) and error.errno != errno.EINVAL:
                raise
            raise InputError(f"{self._path}: damaged: {error}") from error


@contextmanager
def opened_backup(path: Path) -> Iterator[_OpenBackup]:
    """Open a backup for restoring."""
    with open_regular_file(path, _MAX_BACKUP_BYTES) as file:
        try:
            archive = zipfile.ZipFile(file)
        except _UNREADABLE as error:
            raise InputError(f"{path}: not a backup of a station: {error}") from error
        with archive:
            yield _OpenBackup(path, archive)
