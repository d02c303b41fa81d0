"""`RecipeFolder`, `TaughtFiles`: paths of a recipe and of the files that teaching makes."""

import hashlib
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from capture.base.folder_lock import folder_lock
from classify.base.durable_file import make_folder
from classify.base.errors import InputError
from classify.base.regular_file import open_regular_file

# A library of 100,000 references has 2 GB (`classify/library/ps4lib.py`).
_MAX_BYTES = 1 << 34
_BLOCK_BYTES = 1 << 20
_DIGITS = 8  # of a hash in a file name
_LOCK = "teaching.lock"
_VERSION = re.compile(r"version-([1-9][0-9]{0,9})")


class _PathIn:
    """A path in the `folder` of the object whose attribute it is."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __get__(self, owner: "RecipeFolder | TaughtFiles", _: type) -> Path:
        return owner.folder / self._name


@dataclass(frozen=True)
class RecipeFolder:
    """``recipes/NAME.toml``, and ``recipes/NAME`` with a folder for each version."""

    file: Path
    folder: Path
    sets = _PathIn("sets")  # the taught sets
    challenge = _PathIn("challenge")  # the challenge set
    replay = _PathIn("challenge.json")  # outcome of the last replay of the challenge set
    gauge = _PathIn("gauge.json")  # report of the last gauge study
    faults = _PathIn("faults.json")  # outcome of the last study of faults that nobody configured

    @property
    def name(self) -> str:
        """Name of the recipe."""
        return self.folder.name

    def version(self, version: int) -> "TaughtFiles":
        """Return the files of a version of the recipe."""
        return TaughtFiles(self.folder / f"version-{version}")

    def taught_versions(self) -> list[int]:
        """Return the numbers of all versions that were taught, the newest first."""
        matches = (_VERSION.fullmatch(path.name) for path in self.folder.glob("version-*"))
        numbers = [int(match[1]) for match in matches if match is not None]
        return sorted((n for n in numbers if self.version(n).taught.is_file()), reverse=True)

    @contextmanager
    def changing(self) -> Iterator[None]:
        """Lock the recipe against teaching, changes and approval by others during the block."""
        make_folder(self.folder)
        with folder_lock(self.folder, _LOCK):
            yield


@dataclass(frozen=True)
class TaughtFiles:
    """Files that teaching made for one version of a recipe."""

    folder: Path
    library = _PathIn("textures.ps4lib")  # the texture library
    taught = _PathIn("taught.json")  # the measurements of teaching
    report = _PathIn("teaching.html")  # the report of teaching, a page for people
    # The recipe with the measured limits, also where people set other ones.
    measured = _PathIn("measured.toml")

    def defects(self, number: int) -> Path:
        """Return the defect model of the nth texture that passes, from 1."""
        return self.folder / f"defects-{number}.ps4def"

    def pieces(self, number: int) -> Path:
        """Return the piece model of the nth texture that passes, from 1."""
        return self.folder / f"pieces-{number}.ps4piece"

    def approved(self, sha256: str) -> Path:
        """Return the copy of the recipe with this hash, as it was approved."""
        return self.folder / f"approved-{sha256[:_DIGITS]}.toml"


def file_sha256(path: Path) -> str:
    """SHA-256 of a file."""
    digest = hashlib.sha256()
    try:
        with open_regular_file(path, _MAX_BYTES) as file:
            while block := file.read(_BLOCK_BYTES):
                digest.update(block)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error
    return digest.hexdigest()
