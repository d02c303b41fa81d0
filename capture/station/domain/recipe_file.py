"""The files of a recipe: its TOML with a comment for every key, and what teaching made."""

import hashlib
import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from capture.base.folder_lock import folder_lock
from classify.base.durable_file import durable_file, make_folder
from classify.base.errors import InputError
from classify.base.models import Section, read_toml_as
from classify.base.regular_file import open_regular_file

from .errors import RecipeError
from .limits import Limits
from .recipe import Approval, CalibrationRule, CameraSettings, Orientation, Recipe, Region

SUFFIX = ".toml"

_MISSING = (
    "no such recipe; ps4rig station teach makes one; ps4rig station run --collect captures parts "
    "for it"
)
_HEAD = """\
# A recipe of the inspection station. A line that begins with # is a comment.
# After a change run ps4rig station challenge DIR, and
# ps4rig station approve DIR --recipe {name} --by WHO
"""
_MODELS: tuple[type[Section], ...] = (
    Approval, CalibrationRule, CameraSettings, Region, Limits, Orientation, Recipe,
)  # fmt: skip
COMMENTS = {
    field.alias or name: field.description or ""
    for model in _MODELS
    for name, field in model.model_fields.items()
}
"""Meanings of the keys of a recipe."""
_TABLES = ("orientation", "limits", "limits_of", "region", "light", "calibration", "approval")
SECTIONS = {name: f"{COMMENTS[name][0].upper()}{COMMENTS[name][1:]}." for name in _TABLES}
"""Meanings of the sections of a recipe."""
# A library of 100,000 references has 1.1 GB (`classify/library/ps4lib.py`).
_MAX_BYTES = 1 << 34
_BLOCK_BYTES = 1 << 20
_DIGITS = 8  # of a hash in a file name
_LOCK = "teaching.lock"
_VERSION = re.compile(r"version-([1-9][0-9]{0,9})")


def read_recipe(path: Path) -> Recipe:
    """Read a recipe."""
    recipe = read_toml_as(path, Recipe, _MISSING)
    if path.name != recipe.name + SUFFIX:
        raise RecipeError(f"{path}: name = {recipe.name!r}: must be the name of the file")
    return recipe


def write_recipe(path: Path, recipe: Recipe) -> None:
    """Write a recipe, whole or not at all; an existing file is replaced."""
    text = _HEAD.format(name=recipe.name) + "\n".join(_lines(recipe)) + "\n"
    with durable_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _lines(recipe: Recipe) -> Iterator[str]:
    values = {
        field.alias or name: getattr(recipe, name) for name, field in Recipe.model_fields.items()
    }
    for key, value in values.items():
        if key not in SECTIONS:
            yield from _entry(key, value)
    for section, comment in SECTIONS.items():
        value = values[section]
        if section == "limits_of":
            tables = {f"{section}.{_toml(name)}": limits for name, limits in value.items()}
        else:
            tables = {} if value is None else {section: value}
        for number, (header, table) in enumerate(tables.items()):
            yield ""
            if number == 0:
                yield f"# {comment}"
            yield f"[{header}]"
            for key in type(table).model_fields:
                yield from _entry(key, getattr(table, key))


def _entry(key: str, value: object) -> Iterator[str]:
    if value is not None:
        yield f"{key} = {_toml(value)}  # {COMMENTS[key]}"


def _toml(value: object) -> str:
    # Printable text, numbers, booleans and lists of them have the same form in JSON.
    return json.dumps(value, ensure_ascii=False)


class _PathIn:
    """Descriptor of a path in the `folder` of its owner."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __get__(self, owner: "RecipeFolder | TaughtFiles", _: type) -> Path:
        return owner.folder / self._name


@dataclass(frozen=True)
class RecipeFolder:
    """``recipes/NAME.toml``, and ``recipes/NAME`` with a folder for each version."""

    folder: Path
    sets = _PathIn("sets")  # the taught sets
    challenge = _PathIn("challenge")  # the challenge set
    replay = _PathIn("challenge.json")  # outcome of the last replay of the challenge set
    gauge = _PathIn("gauge.json")  # report of the last gauge study
    faults = _PathIn("faults.json")  # outcome of the last fault study

    @property
    def name(self) -> str:
        """Name of the recipe."""
        return self.folder.name

    @property
    def file(self) -> Path:
        """The recipe."""
        return self.folder.with_name(self.name + SUFFIX)

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
