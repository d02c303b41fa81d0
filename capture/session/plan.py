"""The plan of a session: specimens, orientations and settings of the capture."""

import os
import re
import shlex
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import BeforeValidator, Field, field_validator, model_validator

from capture.acquisition.attempts import MAX_AVERAGE
from capture.base.names import SET_SUFFIX, Label, Name, Text, file_name, usable_label
from capture.sets.description import checked_properties
from capture.sets.metadata import Property
from classify.base.errors import InputError
from classify.base.models import Degrees, Section, read_toml_as

# Largest number of sets of a plan: a year of captures at one a minute.
_MAX_SETS = 500_000
_ANGLE = "{angle}"
SEARCH: Literal["search"] = "search"


def _usable_properties(values: object) -> object:
    try:
        return checked_properties(values) if isinstance(values, dict) else values
    except InputError as error:
        raise ValueError(str(error)) from error


def _checked_exposure(value: object) -> object:
    if isinstance(value, str) and value != SEARCH:
        raise ValueError(f"{value!r}: give milliseconds, or {SEARCH!r}")
    return value


def _words(command: str) -> list[str]:
    """Split a command as a shell does, but with the backslashes of Windows paths."""
    split = shlex.shlex(command, posix=True, punctuation_chars=False)
    split.whitespace_split, split.commenters = True, ""
    # A drive such as C:\ marks a Windows path, even if the plan is checked on another system.
    if os.name == "nt" or re.match(r"\W?[A-Za-z]:\\", command):
        split.escape = ""
    return list(split)


_Exposure = Annotated[float | None, Field(gt=0.0, le=10_000.0)] | Literal["search"]


class Specimen(Section):
    """A specimen to capture."""

    id: Name = Field(description="part of the names of files: letters, digits, and _ . -")
    label: Label | None = Field(default=None, description="texture class; the id by default")
    note: Text | None = Field(default=None, description="kept in its sets")
    surface: str | None = Field(default=None, description="below the camera of a simulated rig")
    properties: Annotated[dict[str, Property], BeforeValidator(_usable_properties)] = Field(
        default_factory=dict,
        description="columns of sets.csv by name: texts, numbers, truth values, dates",
    )

    @model_validator(mode="after")
    def _check_label(self) -> Self:
        if self.label is None:
            usable_label(self.id)
        return self


@dataclass(frozen=True)
class PlannedSet:
    """One set of a plan: a specimen at an orientation, for the nth time (from 1)."""

    specimen: str
    orientation_deg: float
    repeat: int
    file_name: str

    @property
    def key(self) -> tuple[str, float, int]:
        """Specimen, orientation and repeat, as of its entry in the journal."""
        return self.specimen, self.orientation_deg, self.repeat

    def __str__(self) -> str:
        repeat = f", repeat {self.repeat}" if self.repeat > 1 else ""
        return f"{self.specimen} at {self.orientation_deg:g} degrees{repeat}"


class SessionPlan(Section):
    """The sets that a session captures, and the settings for them."""

    name: Name = Field(description="folder of the session, beside the plan")
    operator: Text | None = Field(default=None, description="kept in the sets")
    orientations_deg: tuple[Degrees, ...] = Field(
        min_length=1,
        max_length=3600,
        strict=False,
        description="of each specimen, anticlockwise from how it was first placed",
    )
    repeats: int = Field(default=1, ge=1, le=999, description="sets at each orientation")
    average: int = Field(
        default=1, ge=1, le=MAX_AVERAGE, description="frames that each image averages"
    )
    exposure_ms: Annotated[_Exposure, BeforeValidator(_checked_exposure)] = Field(
        default=None,
        description='that of the rig by default; "search" finds one for each specimen',
    )
    file_name: str = Field(
        default="{specimen}-{angle}-{repeat}", max_length=100, description="without .ome.tif"
    )
    calibration_required: bool = Field(
        default=False, description="refuse sets without a calibration that fits the rig"
    )
    turntable: str | None = Field(
        default=None,
        description="program run before each orientation of a specimen, without a shell; "
        "{angle} is the degrees",
    )
    turntable_timeout_s: float = Field(
        default=60.0, gt=0.0, le=3600.0, description="after which the program is given up"
    )
    specimen: tuple[Specimen, ...] = Field(
        min_length=1, max_length=10_000, strict=False, description="in the order of their capture"
    )

    @field_validator("file_name")
    @classmethod
    def _file_name_has_all_placeholders(cls, pattern: str) -> str:
        example = pattern
        for placeholder in ("{specimen}", _ANGLE, "{repeat}"):
            if placeholder not in pattern:
                raise ValueError(f"file_name = {pattern!r}: {placeholder} is missing")
            example = example.replace(placeholder, "0")
        file_name(example)  # raises if it is no usable name
        return pattern

    @field_validator("turntable")
    @classmethod
    def _turntable_is_a_command(cls, command: str | None) -> str | None:
        if command is None:
            return None
        try:
            words = _words(command)
        except ValueError as error:
            raise ValueError(f"turntable = {command!r}: {error}") from error
        if not any(_ANGLE in word for word in words[1:]):
            raise ValueError(
                f"turntable = {command!r}: give a program and {_ANGLE} where the degrees go"
            )
        return command

    @model_validator(mode="after")
    def _each_set_is_planned_once(self) -> Self:
        ids = [specimen.id.casefold() for specimen in self.specimen]
        unique: tuple[tuple[str, Sequence[object]], ...] = (
            ("specimen.id", ids),
            ("orientations_deg", [angle_deg % 360.0 for angle_deg in self.orientations_deg]),
        )
        for key, values in unique:
            repeated = [value for value, count in Counter(values).items() if count > 1]
            if repeated:
                raise ValueError(f"{key}: {repeated[0]} is named twice; name each once")
        if len(self) > _MAX_SETS:
            raise ValueError(f"the plan has {len(self)} sets; up to {_MAX_SETS} are handled")
        files: dict[str, PlannedSet] = {}
        for planned in self.sets():
            # Some file systems ignore case.
            other = files.setdefault(planned.file_name.casefold(), planned)
            if other is not planned:
                raise ValueError(
                    f"{other} and {planned} would both be {planned.file_name}; give another id, or "
                    "another file_name"
                )
        return self

    def __len__(self) -> int:
        return len(self.specimen) * len(self.orientations_deg) * self.repeats

    def sets(self) -> Iterator[PlannedSet]:
        """All sets in the order of their capture."""
        for specimen in self.specimen:
            for orientation_deg in self.orientations_deg:
                for repeat in range(1, self.repeats + 1):
                    yield self.planned(specimen.id, orientation_deg, repeat)

    def planned(self, specimen: str, orientation_deg: float, repeat: int) -> PlannedSet:
        """Return one set with the name of its file."""
        # No str.format: it would evaluate attributes.
        name = self.file_name.replace("{specimen}", specimen)
        name = name.replace(_ANGLE, f"{orientation_deg:g}").replace("{repeat}", str(repeat))
        return PlannedSet(specimen, orientation_deg, repeat, name + SET_SUFFIX)

    def specimen_named(self, name: str) -> Specimen:
        """Return the specimen with this id."""
        return next(specimen for specimen in self.specimen if specimen.id == name)

    def turntable_command(self, orientation_deg: float) -> list[str]:
        """Words of the command that rotates the turntable to an orientation."""
        words = _words(self.turntable or "")
        return [word.replace(_ANGLE, f"{orientation_deg:g}") for word in words]


def read_plan(path: Path) -> SessionPlan:
    """Read a plan."""
    missing = f"no such plan; write one with ps4rig session new {path}"
    return read_toml_as(path, SessionPlan, missing)


_EXAMPLE = """\
# Plan of a capture session. A line that begins with # is a comment.
# See what it means in time and disk space: ps4rig session run PLAN.toml --dry-run

name = "NAME"                # the folder of the session, beside this file
# operator = "Your name"

# Orientations of each specimen in degrees, anticlockwise from how it was first placed.
orientations_deg = [0, 30, 60, 90, 120, 150]
repeats = 1                  # sets at each orientation
average = 1                  # frames that each image averages
# exposure_ms = 20           # for all sets; "search" finds one for each specimen
# calibration_required = true
# turntable = "turn-to {angle}"   # a program that rotates the specimen; it runs without a shell
# turntable_timeout_s = 60

# One block for each specimen. The id becomes part of the names of files.
[[specimen]]
id = "rock-1"
label = "rock"               # texture class; the id if left out
# note = "left corner is worn"
# properties = {mass_g = 12.5, polished = 2026-05-17}   # anything else: columns of sets.csv
surface = "rock"             # for the simulated rig only

[[specimen]]
id = "sand-1"
label = "sand"
surface = "sand"
"""


def example_plan(name: str) -> str:
    """Return a commented plan for a session called `name`."""
    return _EXAMPLE.replace("NAME", name)
