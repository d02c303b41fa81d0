"""The folder of a session: plan, journal, sets and their table."""

import csv
import io
import os
import shutil
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from types import MappingProxyType

from capture.base.folder_lock import LOCK_FILE_SUFFIX, folder_lock
from capture.base.names import SET_SUFFIX
from capture.base.outputs import append_line
from capture.base.utc_time import utc_text
from capture.calibration.lookup import FOLDER as CALIBRATION
from capture.sets.archive import JOURNAL, REPLACED
from capture.sets.captured_set import CapturedSet
from capture.sets.description import as_captured, exact_value
from capture.sets.metadata import SetMetadata
from capture.sets.ome_tiff import read_header
from classify.base.durable_file import TEMPORARY_PREFIX, durable_file, make_folder, write_text
from classify.base.errors import InputError

from .journal import Journal, SetEntry, read_journal
from .plan import PlannedSet, SessionPlan, read_plan

_Cell = str | float | None
COLUMNS = (
    "specimen", "label", "orientation_deg", "repeat", "planned", "state", "file", "captured_utc",
    "exposure_ms", "operator", "note", "calibration", "estimated_deg", "saturated_share",
    "shadowed_share", "blur_px", "warnings", "error", "corrected", "pixels_sha256",
)  # fmt: skip


def _sets_table(
    plan: SessionPlan,
    entries: Sequence[SetEntry],
    present: Collection[tuple[str, float, int]],
    damaged: Mapping[str, str],
) -> str:
    """Return CSV (RFC 4180) of planned sets, then of those no longer planned.

    `present` has the keys of entries with a file, `damaged` the errors of files.
    """
    planned = {entry.key: entry for entry in map(SetEntry.of, plan.sets())}
    entered = {entry.key: entry for entry in entries}
    labels = {specimen.id: specimen.label or specimen.id for specimen in plan.specimen}
    rows = []
    for key, entry in {**planned, **entered}.items():
        error = damaged.get(entry.file or "")
        state = "missing"
        if entry.skipped is not None:
            state = "left out"
        elif key in present:
            state = "captured" if error is None else "damaged"
        row = _row(entry) | {"planned": exact_value(key in planned), "state": state, "error": error}
        if entry.description is None:
            row["label"] = labels.get(entry.specimen)
        rows.append(row)
    descriptions = [entry.description for entry in entries if entry.description is not None]
    properties = sorted(
        {_column(name) for description in descriptions for name in description.properties}
    )
    lights = max((len(entry.measures.led_levels) for entry in entries if entry.measures), default=0)
    text = io.StringIO()
    writer = csv.DictWriter(text, [*COLUMNS, *map(_level, range(lights)), *properties])
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def _row(entry: SetEntry) -> dict[str, _Cell]:
    row: dict[str, _Cell] = {
        "specimen": entry.entered_specimen,
        "orientation_deg": exact_value(entry.entered_deg),
        "repeat": entry.repeat,
        "file": entry.file,
        "captured_utc": entry.captured_utc,
        "pixels_sha256": entry.pixels_sha256,
        "warnings": entry.skipped,
    }
    description, measures = entry.description, entry.measures
    if description is not None:
        row |= {
            "label": description.label,
            "exposure_ms": exact_value(description.exposure_ms),
            "operator": description.operator,
            "note": description.note,
            "calibration": " ".join(description.calibration_ids),
            "corrected": " ".join(description.corrected),
        }
        row |= {_column(name): exact_value(value) for name, value in description.properties.items()}
    if measures is not None:
        row |= {
            "estimated_deg": _rounded(measures.estimated_deg, 2),
            "saturated_share": _rounded(measures.saturated, 6),
            "shadowed_share": _rounded(measures.shadowed, 6),
            "blur_px": _rounded(measures.blur_px, 2),
            "warnings": "; ".join(measures.warnings),
        }
        row |= {_level(k): _rounded(value, 6) for k, value in enumerate(measures.led_levels)}
    return row


def _level(light: int) -> str:
    return f"level_led_{light}"


def _column(name: str) -> str:
    """Column of a property: its name, unless every table has a column of this name."""
    folded = name.casefold()
    is_reserved = folded in COLUMNS or folded.startswith(("level_led_", "property_"))
    return f"property_{name}" if is_reserved else name


def _rounded(value: float | None, digits: int) -> float | None:
    return None if value is None else round(value, digits)


PLAN, TABLE = "plan.toml", "sets.csv"
_LOG, REPORT = "session.log", "report.html"
SETS, _LOCK, _RESERVE = "sets", "session.lock", "session.reserve"
_LOCKS = (_LOCK, _LOCK + LOCK_FILE_SUFFIX)
# Size of a set in journal and table: 1.2 kB on four lights without warnings (test_disk_full.py).
_ENTRY_BYTES = 2_000
# The log, and blocks of the file system that are not filled.
_SPARE_BYTES = 64_000


def _read_error(path: Path, error: InputError) -> InputError | None:
    """Return an error that says what to do if disk or memory failed; None for a damaged set."""
    cause = error.__cause__
    if isinstance(cause, MemoryError):
        reason = "not enough memory"
    elif isinstance(cause, OSError) and cause.errno is not None:
        reason = cause.strerror or str(cause)
    else:
        return None
    return InputError(
        f"{path}: cannot be read ({reason}), but may be intact; try again, or remove the file to "
        "capture the set again"
    )


class SessionFolder:
    """A session on disk, for reading; `session_folder` opens one for writing."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.plan: SessionPlan = read_plan(path / PLAN)
        self.journal: Journal = read_journal(path / JOURNAL)

    def missing(
        self, plan: SessionPlan | None = None, *, left_out: bool = False
    ) -> list[PlannedSet]:
        """Planned sets without a file, of the session or of `plan`.

        Sets that were left out are missing only with `left_out`.
        """

        def is_missing(planned: PlannedSet) -> bool:
            entry = self.journal.entry_of(planned)
            if entry is None or entry.file is None:
                return entry is None or left_out
            return not (self.path / entry.file).is_file()

        return [planned for planned in (plan or self.plan).sets() if is_missing(planned)]

    def left_out(self) -> list[SetEntry]:
        """Entries of the planned sets that were left out."""
        entries = (self.journal.entry_of(planned) for planned in self.plan.sets())
        return [entry for entry in entries if entry is not None and entry.file is None]

    def captured(self) -> list[SetEntry]:
        """Entries whose file exists: planned sets first, in the order of the plan."""
        return [
            entry for entry in self.entries() if entry.file and (self.path / entry.file).is_file()
        ]

    def unplanned(self, plan: SessionPlan | None = None) -> list[SetEntry]:
        """Entries of captured sets that are not planned; `plan` as for `missing`."""
        planned = {planned_set.key for planned_set in (plan or self.plan).sets()}
        return [entry for entry in self.captured() if entry.key not in planned]

    def log(self, line: str) -> None:
        """Append a line with the time to ``session.log``."""
        append_line(self.path / _LOG, f"{utc_text()} {line}")

    def reserve(self) -> None:
        """Reserve the disk space for the end of a run, in case other programs fill the disk."""
        path, specimens = self.path / _RESERVE, self.plan.specimen
        # Each entry and row repeats the specimen of the plan.
        description_bytes = sum(
            len(specimen.model_dump_json().encode()) for specimen in specimens
        ) / len(specimens)
        size = round((_ENTRY_BYTES + 2 * description_bytes) * len(self.plan)) + _SPARE_BYTES
        with durable_file(path) as temporary:
            # Random bytes take their space on a file system that compresses, too.
            temporary.write_bytes(os.urandom(size))

    def release(self) -> None:
        """Release the space of `reserve`."""
        (self.path / _RESERVE).unlink(missing_ok=True)

    def update(self, journal: Journal) -> None:
        """Write the journal, and then the table that follows from it."""
        journal.write(self.path / JOURNAL)
        self.journal = journal
        self.write_table()

    def write_table(self, damaged: Mapping[str, str] = MappingProxyType({})) -> None:
        """Write ``sets.csv`` anew from the journal; `damaged` has the errors of files."""
        table = _sets_table(
            self.plan, [*self.entries()], {entry.key for entry in self.captured()}, damaged
        )
        write_text(self.path / TABLE, table)

    def file_of(self, planned: PlannedSet) -> Path:
        """Path of the file of a planned set."""
        return self.path / SETS / planned.file_name

    def keep(self, planned: PlannedSet, captured: CapturedSet, entry: SetEntry) -> SetEntry:
        """Write a set and its entry. An earlier file of the same set moves to ``replaced``."""
        path = self.file_of(planned)
        self.set_aside(planned)
        make_folder(path.parent)
        captured.save(path)
        stored = entry.model_copy(update={"file": f"{SETS}/{path.name}"})
        self.update(self.journal.with_entry(stored))
        return stored

    def set_aside(self, planned: PlannedSet) -> None:
        """Move the file of a planned set to ``replaced``, if there is one."""
        entry = self.journal.entry_of(planned)
        # An entry keeps its file when file_name in the plan changes.
        entered = [] if entry is None or entry.file is None else [self.path / entry.file]
        for path in {self.file_of(planned), *entered}:
            if path.exists():
                make_folder(self.path / REPLACED)
                stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%S%f")
                path.rename(self.path / REPLACED / f"{stamp}-{path.name}")

    def entries(self) -> Iterator[SetEntry]:
        """Entries of the planned sets in the order of the plan, then those no longer planned."""
        planned = [self.journal.entry_of(planned) for planned in self.plan.sets()]
        entered = {entry.key: entry for entry in planned if entry is not None}
        others = sorted((entry for entry in self.journal.entries if entry.key not in entered),
                        key=lambda entry: entry.key)  # fmt: skip
        yield from (*entered.values(), *others)

    def read_again(self) -> Iterator[tuple[PlannedSet, SetMetadata | str | InputError]]:
        """Read each captured set, planned or not.

        Yields its metadata, why it is damaged, or the error of a file that may be intact.
        """
        for entry in self.captured():
            path, planned = self.path / str(entry.file), self.plan.planned(*entry.key)
            try:
                metadata = CapturedSet.load(path).metadata
            except InputError as error:
                damage = str(error).removeprefix(f"{path}: ")
                yield planned, _read_error(path, error) or damage
                continue
            if metadata.pixels_sha256 == entry.pixels_sha256:
                yield planned, metadata
            elif not self._is_unentered(planned, metadata):
                yield planned, "its pixels are not those that the journal names"

    def give_up(self, planned: PlannedSet) -> None:
        """Move the file of a captured set to ``replaced``, and make the set missing again."""
        self.set_aside(planned)
        self.update(self.journal.without_entry_of(planned))

    def orphans(self) -> Iterator[tuple[PlannedSet, CapturedSet]]:
        """Intact files of planned sets that a killed run could not enter into the journal."""
        for planned in self.plan.sets():
            path, entry = self.file_of(planned), self.journal.entry_of(planned)
            if path.is_file() and (entry is None or entry.file == f"{SETS}/{path.name}"):
                try:
                    header, _ = read_header(path)
                    if self._is_unentered(planned, header):
                        yield planned, CapturedSet.load(path)
                except InputError as error:
                    if failed := _read_error(path, error):
                        raise failed from error

    def _is_unentered(self, planned: PlannedSet, metadata: SetMetadata) -> bool:
        """Whether a file is of a planned set and of this rig, and has no entry.

        If the planned set has an entry, the file counts only if it was captured during a run, not
        copied to the folder.
        """
        captured_as = [as_captured(metadata, name) for name in ("specimen", "orientation_deg")]
        lights = len(metadata.lighting.directions)
        return (
            captured_as == [planned.specimen, planned.orientation_deg]
            and self.journal.lights in (None, lights)
            and self.journal.entry_with(metadata.pixels_sha256) is None
            and (
                self.journal.entry_of(planned) is None
                or self.journal.has_run_at(metadata.created_utc)
            )
        )

    def first_set_of(self, specimen: str) -> Path | None:
        """Path of the first captured set of a specimen, None if there is none."""
        sets = self.sets_of(specimen)
        return self.path / str(sets[0].file) if sets and specimen else None

    def sets_of(self, specimen: str) -> list[SetEntry]:
        """Entries of the captured sets of a specimen, those that were planned as such first."""
        sets = [entry for entry in self.captured() if entry.entered_specimen == specimen]
        return sorted(sets, key=lambda entry: entry.specimen != specimen)

    def bytes_of_sets(self) -> int:
        """Size of all captured sets."""
        return sum(path.stat().st_size for path in (self.path / SETS).glob(f"*{SET_SUFFIX}"))


def read_session(path: Path) -> SessionFolder:
    """Read a session without locking it; to write, use `session_folder`."""
    if not (path / JOURNAL).is_file():
        if (path / PLAN).is_file() and _is_without_journal(path):
            raise InputError(
                f"{path}: {JOURNAL} is missing; ps4rig session run PLAN, with the plan beside the "
                "folder, makes it again from the sets"
            )
        raise InputError(f"{path}: not the folder of a session; ps4rig session run PLAN makes one")
    return SessionFolder(path)


@contextmanager
def session_folder(path: Path) -> Iterator[SessionFolder]:
    """Open a session for writing, for this program alone."""
    read_session(path)
    with folder_lock(path, _LOCK):
        yield SessionFolder(path)


def make_session(plan_path: Path) -> Path:
    """Make the folder of a plan beside it, unless it exists, and return its path.

    The journal is written last, so that a folder with a journal is complete.
    """
    plan = read_plan(plan_path)
    folder = plan_path.absolute().parent / plan.name
    if (folder / JOURNAL).is_file():
        return folder
    if folder.exists() and not (folder.is_dir() and _is_without_journal(folder)):
        raise InputError(
            f"{folder}: exists and is not a session; choose another name in {plan_path}"
        )
    make_folder(folder / SETS)
    make_folder(folder / CALIBRATION)
    if not (folder / PLAN).is_file():
        with durable_file(folder / PLAN) as temporary:
            shutil.copyfile(plan_path, temporary)
    Journal().write(folder / JOURNAL)
    return folder


def _is_without_journal(folder: Path) -> bool:
    """Whether a folder has only files of a session, without the journal.

    The next run then enters the sets into a new journal.
    """
    names = {path.name for path in folder.iterdir() if not path.name.startswith(TEMPORARY_PREFIX)}
    return names <= {PLAN, TABLE, _LOG, REPORT, SETS, CALIBRATION, REPLACED, _RESERVE, *_LOCKS}
