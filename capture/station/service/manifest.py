"""`Manifest`: the contents of a backup of a station, with the hash of each file."""

from pathlib import PurePosixPath
from typing import Annotated, Literal

from pydantic import AfterValidator, FailFast, Field

from classify.base.models import Record

MANIFEST = "backup.json"
MAX_FILES = 2_000_000
"""Largest number of files: those of three weeks with a failed part a second. The manifest then has
400 MB."""
MAX_FOLDERS = 16
"""Largest number of folders inside each other; a station makes five."""


def _inside(text: str) -> str:
    """Check that a name is of a file inside a folder."""
    parts = PurePosixPath(text).parts
    if len(parts) > MAX_FOLDERS:
        raise ValueError(f"{text[:100]!r} lies in more than {MAX_FOLDERS} folders")
    if text != "/".join(parts) or parts[:1] == ("/",) or ".." in parts or "\0" in text:
        raise ValueError(f"{text!r} is not the name of a file inside a folder")
    text.encode()  # names that are not UTF-8 raise a ValueError, too
    return text


_InnerPath = Annotated[str, Field(min_length=1, max_length=4096), AfterValidator(_inside)]
_Text = Annotated[str, Field(max_length=200)]
_Count = Annotated[int, Field(ge=0)]


class StoredFile(Record):
    """A file of a backup."""

    path: _InnerPath
    bytes: _Count
    sha256: str = Field(pattern=r"^[0-9a-f]{64}$")


class Manifest(Record):
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
    missing: Annotated[tuple[_InnerPath, ...], Field(max_length=MAX_FILES), FailFast()]
    files: Annotated[tuple[StoredFile, ...], Field(max_length=MAX_FILES), FailFast()]
