"""Restore a station from a backup: every file with its hash, or nothing."""

import errno
import shutil
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from hashlib import sha256
from pathlib import Path

from pydantic import ValidationError

from capture.station.domain.folder import StationFolder
from capture.station.domain.own_folder import SECRETS
from capture.station.domain.private_file import OWNER_ONLY
from classify.base.durable_file import sync, temporary_path
from classify.base.errors import InputError
from classify.base.regular_file import open_regular_file

from .manifest import MANIFEST, Manifest, StoredFile

_MAX_BYTES = 1 << 44
_MAX_MANIFEST_BYTES = 1 << 29
_BLOCK_BYTES = 1 << 20
# What zipfile and zlib raise for a damaged file; RuntimeError stands for encrypted members.
_UNREADABLE = (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError)


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
        if folder.is_symlink() or (folder.exists() and not _is_empty_folder(folder)):
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

    def _read_manifest(self) -> Manifest:
        with self._readable():
            info = self._archive.getinfo(MANIFEST)
            if info.file_size > _MAX_MANIFEST_BYTES or info.compress_type != zipfile.ZIP_STORED:
                raise InputError(
                    f"{self._path}: no backup of a station: its manifest of {info.file_size} bytes "
                    "is compressed, or too large"
                )
            text = self._archive.read(info)
        try:
            return Manifest.model_validate_json(text)
        except ValidationError as error:
            first = error.errors()[0]
            place = ".".join(map(str, first["loc"]))
            raise InputError(
                f"{self._path}: its manifest cannot be used: {place}: {first['msg']}"
            ) from error

    def _extract(self, file: StoredFile, folder: Path) -> None:
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
    with open_regular_file(path, _MAX_BYTES) as file:
        try:
            archive = zipfile.ZipFile(file)
        except _UNREADABLE as error:
            raise InputError(f"{path}: not a backup of a station: {error}") from error
        with archive:
            yield _OpenBackup(path, archive)


def _is_empty_folder(path: Path) -> bool:
    return path.is_dir() and not any(path.iterdir())
