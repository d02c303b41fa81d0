"""Find the calibration of a captured set, and check that it holds for the set."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from capture.base.errors import CalibrationError
from classify.base.durable_file import make_folder
from classify.base.regular_file import read_once

from .ps4cal import SUFFIX, CalibrationFile, utc_of
from .setting import Setting

FOLDER = "calibration"
# The interval at which instruments are usually calibrated again (ILAC-G24, OIML D 10).
OLD_DAYS = 365
_HASH_DIGITS = 8  # in messages and file names


@dataclass(frozen=True, eq=False)
class FoundCalibration:
    """A calibration that holds for a set, and warnings about it."""

    path: Path
    file: CalibrationFile
    warnings: tuple[str, ...] = ()

    @classmethod
    def of_rig(cls, path: str | Path | None) -> Self | None:
        """Read the calibration that a rig names; None for a rig without one."""
        return None if path is None else cls(Path(path), read_calibration(Path(path)))


def find_calibration(
    path: Path,
    hashes: tuple[str, ...],
    setting: Setting,
    capture_date: str,
    chosen: Path | None,
    remedy: str,
) -> FoundCalibration | None:
    """Find the calibration of a set: `chosen`, or one of the `hashes` beside the file at `path`."""
    if chosen is not None:
        file_path, file = chosen, read_calibration(chosen)
    elif hashes:
        file_path, file = _with_hash(path, hashes, remedy)
    else:
        return None
    check_setting(file, setting, str(path))
    warnings = (*file.warnings(), *_age_warnings(file, capture_date))
    return FoundCalibration(file_path, file, warnings)


def check_setting(file: CalibrationFile, setting: Setting, owner: str) -> None:
    """Check that a calibration holds for a set or rig, the `owner` in the message."""
    causes: dict[str, list[str]] = {}
    for name in sorted(file.records):
        for difference in file.differences(name, setting):
            causes.setdefault(difference, []).append(name.replace("_", " "))
    if causes:
        reasons = "; ".join(f"{cause} ({', '.join(parts)})" for cause, parts in causes.items())
        subject = "the calibration" if file.path is None else f"{file.path}: the calibration"
        raise CalibrationError(
            f"{subject} does not hold for {owner}: {reasons}; restore the setting, or "
            "calibrate again at this one"
        )


@read_once(files=8)
def read_calibration(path: Path) -> CalibrationFile:
    """Read a calibration, or return the one that was read from the unchanged file before."""
    return CalibrationFile.read(path)


def keep_beside(file: CalibrationFile, set_path: Path) -> None:
    """Put a calibration, if missing, where the set at `set_path` finds it by its hash."""
    set_folder = set_path.absolute().parent
    shared_folder = set_folder.parent / FOLDER
    folder = shared_folder if shared_folder.is_dir() else set_folder / FOLDER
    stem = FOLDER if file.path is None else file.path.stem
    copy = folder / f"{stem}-{file.hash[:_HASH_DIGITS]}{SUFFIX}"
    if _hash_at(copy) != file.hash:
        make_folder(folder)
        file.write(copy)


def _hash_at(path: Path) -> str | None:
    try:
        return read_calibration(path).hash
    except CalibrationError:
        return None


def _with_hash(path: Path, hashes: tuple[str, ...], remedy: str) -> tuple[Path, CalibrationFile]:
    """Find the calibration with one of these hashes for the set at `path`."""
    rejected: list[str] = []
    for candidate in _candidates(path):
        try:
            file = read_calibration(candidate)
        except CalibrationError as error:
            rejected.append(str(error))
            continue
        if file.hash in hashes:
            return candidate, file
        rejected.append(f"{candidate} is {file.hash[:_HASH_DIGITS]}")
    candidates = f" ({'; '.join(rejected)})" if rejected else ""
    raise CalibrationError(
        f"{path}: was captured with the calibration {hashes[0][:_HASH_DIGITS]}, which is "
        f"neither beside it nor in a folder {FOLDER}{candidates}; copy it there, or {remedy}"
    )


def _candidates(path: Path) -> Iterator[Path]:
    folder = path.absolute().parent
    for searched in (folder, folder / FOLDER, folder.parent / FOLDER):
        yield from sorted(
            candidate for candidate in searched.glob(f"*{SUFFIX}") if candidate.is_file()
        )


def _age_warnings(file: CalibrationFile, capture_date: str) -> Iterator[str]:
    try:
        captured = utc_of(capture_date)
    except ValueError:  # not a date
        return
    ages = {name: record.age_days(captured) or 0 for name, record in file.records.items()}
    old_parts = [name.replace("_", " ") for name, days in ages.items() if days > OLD_DAYS]
    if old_parts:
        yield (
            f"the calibration ({', '.join(old_parts)}) was measured {max(ages.values())} days "
            "before the set was captured; calibrate again"
        )
