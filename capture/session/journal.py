"""The journal of a session: its runs and sets, in one file that is replaced whole."""

from collections.abc import Mapping
from datetime import datetime, timedelta
from functools import cached_property
from pathlib import Path, PureWindowsPath
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, Field

from capture.sets.description import FIELDS
from capture.sets.metadata import Property, SetMetadata
from classify.base.models import Record

from .plan import PlannedSet

_MAX_BYTES = 1 << 30  # 500,000 sets, the most that a plan has, with 2 kB each
FinishReason = Literal["complete", "incomplete", "stopped", "interrupted", "failed"]


class SetMeasures(Record):
    """Measures of a set right after its capture."""

    led_levels: tuple[float, ...]  # mean signal of each light, as a share of full scale
    saturated: float  # share of the pixels at full scale
    shadowed: float  # share of the pixels in shadow of a light
    # Modulo 180, by comparison with the first set of the specimen; None for that set.
    estimated_deg: float | None = None
    # Against the first set of the specimen; negative where sharper.
    blur_px: float | None = None
    warnings: tuple[str, ...] = ()


def _with_slashes(file: str) -> str:
    return PureWindowsPath(file).as_posix()  # also of a journal that was written on Windows


class Description(Record):
    """The description in the file of a set."""

    label: str | None
    specimen: str | None
    operator: str | None
    note: str | None
    orientation_deg: float | None
    exposure_ms: float | None = None
    calibration_ids: tuple[str, ...] = ()
    properties: dict[str, Property] = Field(default_factory=dict)
    corrected: tuple[str, ...] = ()  # fields that ``ps4rig info --set`` changed

    @classmethod
    def of(cls, metadata: SetMetadata) -> Self:
        """Return the description in the metadata of a set."""
        corrected = dict.fromkeys(correction.field for correction in metadata.corrections)
        return cls(
            **{name: getattr(metadata, name) for name in FIELDS},
            exposure_ms=None if metadata.camera is None else metadata.camera.exposure_ms,
            calibration_ids=metadata.calibration_ids,
            properties=metadata.properties,
            corrected=tuple(corrected),
        )


class SetEntry(Record):
    """A planned set that has its file, or was left out."""

    specimen: str
    orientation_deg: float
    repeat: int = Field(ge=1)
    file: Annotated[str, AfterValidator(_with_slashes)] | None = None
    pixels_sha256: str | None = None
    captured_utc: str | None = None
    # With later corrections; None for a set that was left out.
    description: Description | None = None
    measures: SetMeasures | None = None
    skipped: str | None = None  # why it was left out; None for a captured set

    @classmethod
    def of(
        cls,
        planned: PlannedSet,
        metadata: SetMetadata | None = None,
        measures: SetMeasures | None = None,
        *,
        skipped: str | None = None,
    ) -> Self:
        """Return the entry of a planned set: captured, with its metadata and measures, or not."""
        return cls(
            specimen=planned.specimen,
            orientation_deg=planned.orientation_deg,
            repeat=planned.repeat,
            pixels_sha256=None if metadata is None else metadata.pixels_sha256,
            captured_utc=None if metadata is None else metadata.created_utc,
            description=None if metadata is None else Description.of(metadata),
            measures=measures,
            skipped=skipped,
        )

    @property
    def key(self) -> tuple[str, float, int]:
        """Specimen, orientation and repeat, which identify the planned set."""
        return self.specimen, self.orientation_deg, self.repeat

    @property
    def entered_deg(self) -> float | None:
        """Orientation of the set as planned or corrected; None if a correction removed it."""
        return (
            self.orientation_deg if self.description is None else self.description.orientation_deg
        )

    @property
    def entered_specimen(self) -> str:
        """Specimen of the set as planned or corrected; empty if a correction removed it."""
        return self.specimen if self.description is None else self.description.specimen or ""


class RunRecord(Record):
    """One run of the program on the session."""

    started_utc: str
    rig: str
    settings: dict[str, Any]  # of the rig, that the sets depend on
    simulated: bool
    software_version: str
    ended_utc: str | None = None  # None if it was killed
    finish: FinishReason | None = None
    reason: str | None = None


class Journal(Record):
    """Runs of a session, and an entry for each set that was captured or left out."""

    schema_version: Literal[1] = 1
    runs: tuple[RunRecord, ...] = ()
    entries: Annotated[tuple[SetEntry, ...], Field(max_length=1_000_000)] = ()

    def with_entry(self, entry: SetEntry) -> Self:
        """Return a journal with `entry` in place of an earlier one of the same planned set."""
        others = tuple(other for other in self.entries if other.key != entry.key)
        return type(self)(runs=self.runs, entries=(*others, entry))

    def without_entry_of(self, planned: PlannedSet) -> Self:
        """Return a journal in which a planned set is missing."""
        others = tuple(entry for entry in self.entries if entry is not self.entry_of(planned))
        return type(self)(runs=self.runs, entries=others)

    def with_run(self, run: RunRecord) -> Self:
        """Return a journal with one more run."""
        return type(self)(runs=(*self.runs, run), entries=self.entries)

    def with_run_ended(self, ended_utc: str, finish: FinishReason, reason: str | None) -> Self:
        """Return a journal whose last run has ended."""
        ended = self.runs[-1].model_copy(
            update={"ended_utc": ended_utc, "finish": finish, "reason": reason}
        )
        return type(self)(runs=(*self.runs[:-1], ended), entries=self.entries)

    def entry_of(self, planned: PlannedSet) -> SetEntry | None:
        """Return the entry of a planned set; None where it is still missing."""
        return self._by_key.get(planned.key)

    def entry_with(self, pixels_sha256: str) -> SetEntry | None:
        """Return the entry of the set with these pixels; None if there is none."""
        matching = (entry for entry in self.entries if entry.pixels_sha256 == pixels_sha256)
        return next(matching, None)

    @property
    def lights(self) -> int | None:
        """Number of lights of the captured sets; None before the first."""
        counts = (len(entry.measures.led_levels) for entry in self.entries if entry.measures)
        return next(counts, None)

    def has_run_at(self, moment_utc: str) -> bool:
        """Whether a run was active at a time; a killed run ends when the next one begins."""
        moment = datetime.fromisoformat(moment_utc)
        started = [run for run in self.runs if datetime.fromisoformat(run.started_utc) <= moment]
        if not started:
            return False
        ended_utc = started[-1].ended_utc
        if ended_utc is None:
            return True
        # The end of a run is kept in whole seconds.
        return moment < datetime.fromisoformat(ended_utc) + timedelta(seconds=1)

    @cached_property
    def _by_key(self) -> Mapping[tuple[str, float, int], SetEntry]:
        return {entry.key: entry for entry in self.entries}


def read_journal(path: Path) -> Journal:
    """Read a journal."""
    return Journal.read(path, _MAX_BYTES, "restore it, or read it with the ps4rig that wrote it")
