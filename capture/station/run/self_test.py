"""The self-test of a station: the checks before it accepts a trigger."""

import shutil
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

from capture.acquisition.attempts import MAX_ATTEMPTS
from capture.base.utc_time import local_time, utc_text
from capture.calibration.lookup import FoundCalibration
from capture.calibration.ps4cal import CalibrationFile
from capture.procedures.rig_check import checks_of_drift, drift_of_rig
from capture.station.domain.fault import Fault
from capture.station.domain.folder import PARTS
from capture.station.domain.recipe import CalibrationRule
from capture.station.domain.verdict import Cause
from capture.station.results.store import ResultStore
from classify.base.durable_file import durable_file, make_folder
from rig import HardwareError, Rig
from rig.doctor.check import Check, run_checks
from rig.doctor.light_images import capture_light_images, check_leds

from .events import SelfTestFinished

# Allowed difference of the clocks of two computers that write to one database.
_CLOCK_TOLERANCE = timedelta(seconds=2)
# Hidden, so that a backup leaves it out: the backup would fail when the file is removed meanwhile.
_PROBE = ".self-test.tmp"


class SelfTestFailed(HardwareError):  # noqa: N818 - the state of the station, no program error
    """The self-test found faults; the message names all of them, `device` is that of the first."""

    def __init__(self, faults: Sequence[Check]) -> None:
        texts = [(check.name, check.seen, check.advice) for check in faults]
        super().__init__("self-test: " + "; ".join(": ".join(filter(None, text)) for text in texts))
        self.device = faults[0].device


def require_no_fault(checks: Iterable[Check]) -> None:
    """Raise SelfTestFailed, with every fault, if a check found one."""
    faults = [check for check in checks if check.status == "fault"]
    if faults:
        raise SelfTestFailed(faults)


class SelfTest:
    """Collects the checks of a self-test, and publishes them if they changed."""

    def __init__(self, publish: Callable[[SelfTestFinished], None]) -> None:
        self._publish = publish
        self._published: list[str] = []

    @contextmanager
    def collecting(self) -> Iterator[Callable[[list[Check]], None]]:
        """Yield a function that adds checks and raises like `require_no_fault`."""
        checks: list[Check] = []

        def require(results: list[Check]) -> None:
            checks.extend(results)
            require_no_fault(checks)

        try:
            yield require
        finally:
            texts = [f"{check.name} {check.status}" for check in checks]
            if texts != self._published:
                self._publish(SelfTestFinished(tuple(checks)))
            self._published = texts


def disk_fault(folder: Path, floor_mb: int, sets_bytes: int) -> Fault | None:
    """Return why no set may be written to `folder`; `sets_bytes` is space that sets will take."""
    try:
        free_bytes = shutil.disk_usage(folder).free
    except OSError as error:
        return Fault(Cause.STORAGE, f"{folder}: {error.strerror}", "disk")
    if free_bytes - sets_bytes >= floor_mb * 1_000_000:
        return None
    needed = f", the next sets need {sets_bytes / 1e6:.0f} MB" if sets_bytes else ""
    free_mb = free_bytes / 1e6
    text = f"{free_mb:.0f} MB free on the disk, the floor is {floor_mb} MB{needed}; make room"
    return Fault(Cause.STORAGE, text, "disk", free_mb, floor_mb)


def check_disk(folder: Path, floor_mb: int, set_bytes: int) -> Iterator[Check]:
    """Check that a set can be written below `folder`, and that the floor stays free then."""
    make_folder(folder / PARTS)
    fault = disk_fault(folder / PARTS, floor_mb, set_bytes)
    if fault is not None:
        yield Check("disk", "fault", fault.detail, device="disk")
        return
    with durable_file(folder / PARTS / _PROBE) as probe:
        probe.write_bytes(bytes(set_bytes))
    (folder / PARTS / _PROBE).unlink()
    yield Check("disk", "ok", f"can be written, more than {floor_mb} MB free", device="disk")


def check_results(store: ResultStore) -> Iterator[Check]:
    """Check that a row can be written, and that the clock is not behind the last result."""
    store.check_writable(utc_text(timespec="milliseconds"))
    last = next(store.parts(newest=1), None)
    yield Check("results", "ok", "the database can be written", device="database")
    if last is None:
        yield Check("clock", "ok", "there is no earlier result")
        return
    last_at = local_time(last.result.decided_utc)
    behind = datetime.fromisoformat(last.result.decided_utc) - datetime.now(UTC)
    if behind > _CLOCK_TOLERANCE:
        text = f"{behind.total_seconds():.0f} s behind the last result, of {last_at}"
        yield Check("clock", "warning", text, "set the clock; numbers of parts keep their order")
        return
    yield Check("clock", "ok", f"after the last result, of {last_at}")


def check_calibration_age(
    calibration: FoundCalibration | None, rule: CalibrationRule
) -> Iterator[Check]:
    """Check the ages of the calibration, and that there is one where the recipe requires it."""
    name = "calibration"
    if calibration is None:
        if rule.required:
            advice = "set calibration = 'NAME.ps4cal' in rig.toml; ps4rig calibrate makes one"
            yield Check(name, "fault", "the recipe requires one, the rig names none", advice)
        return
    now = datetime.now(UTC)
    ages_days = {part: record.age_days(now) for part, record in calibration.file.records.items()}
    for part, age_days in ages_days.items():
        fault = rule.age_fault(age_days)
        if fault is not None:
            yield Check(name, "fault", f"{part.replace('_', ' ')} {fault}")
            return
    oldest_days = max(filter(None, ages_days.values()), default=0)
    yield Check(name, "ok", f"{oldest_days} days old, the recipe allows {rule.max_age_days}")


def check_setting(faults: Iterable[str]) -> Iterator[Check]:
    """Report why no set of the rig could be judged."""
    advice = "run the rig that was taught, or teach the recipe again"
    for text in faults:
        yield Check("taught rig", "fault", text, advice, "rig")


def check_rig(rig: Rig, sheet: CalibrationFile | None) -> list[Check]:
    """Check an open rig: ambient light, light of each LED, and drift on a white sheet.

    After a fault the checks are repeated, because most disturbances are short.
    """

    def checks() -> Iterator[Check]:
        yield from check_leds(capture_light_images(rig))
        if sheet is not None:
            yield from checks_of_drift(drift_of_rig(rig, sheet))

    def recover() -> Iterator[Check]:
        rig.lights.recover()
        yield from ()  # `run_checks` makes a check of an exception

    for _ in range(MAX_ATTEMPTS):
        results = run_checks("rig", checks)
        if not any(check.status == "fault" for check in results):
            break
        # A transmission error leaves the line to the controller unusable until it is opened anew.
        results += run_checks("light controller", recover)
    return [replace(check, device=check.device or "camera") for check in results]
