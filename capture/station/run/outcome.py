"""`PartJudge`: from an exposed part to its result; any exception gives the verdict ERROR."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from importlib.metadata import version
from typing import Any, TypeVar

from capture.base.errors import CalibrationError, SetRejected
from capture.sets.captured_set import CapturedSet
from capture.station.domain.fault import Fault, fault_of
from capture.station.domain.folder import set_file_of
from capture.station.domain.verdict import Cause, Decision, Verdict
from capture.station.judge.inspector import Collector, Inspector
from capture.station.judge.judge import STOP_LED_LEVEL
from capture.station.results.part_result import PartResult
from capture.station.results.store import BegunPart
from classify.base.threads import on_free_processor

from .station_clock import StationClock

_T = TypeVar("_T")

SOFTWARE_VERSION = version("ps4rig")


@dataclass(frozen=True, eq=False)
class ExposedPart:
    """A part that needs no further exposure."""

    begun: BegunPart
    captured: CapturedSet | None
    error: BaseException | None
    exposed_s: float  # end of the last exposure, or the trigger without one; monotonic clock
    exposed_utc: str | None  # None if there is no set
    # ``capture``: from the trigger to the end of the exposure; ``checks``: after it.
    timings_ms: dict[str, float]
    notes: tuple[str, ...] = ()

    @property
    def rig_fault(self) -> Fault | None:
        """Fault after which the rig must be opened again; None for an error of the set alone."""
        if self.error is None or isinstance(self.error, SetRejected | CalibrationError):
            return None
        return fault_of(self.error)


class PartJudge:
    """Makes the result of an exposed part."""

    def __init__(
        self,
        station: str,
        operator: str | None,
        inspector: Inspector | Collector,
        recipe_fields: dict[str, Any],
        save: Callable[[CapturedSet, str], None],
        clock: StationClock,
    ) -> None:
        self._station, self._operator = station, operator
        self._inspector, self._recipe_fields = inspector, recipe_fields
        self._save, self._clock = save, clock

    @on_free_processor()
    def result_of(
        self, part: ExposedPart, writer: ThreadPoolExecutor
    ) -> tuple[PartResult, Fault | None, BaseException | None]:
        """Judge a part while `writer` saves its set.

        Return the result, the fault of a device, and an exception. An exception, also one of
        saving, gives the verdict ERROR.
        """
        failures: list[tuple[BaseException, Cause | None]] = []
        if part.error is not None:
            failures.append((part.error, None))

        def attempted(work: Callable[[], _T], cause: Cause | None = None) -> _T | None:
            """Do `work`; keep an exception among the failures."""
            try:
                return work()
            except BaseException as error:
                failures.append((error, cause))
                return None

        unjudged = self._unjudged(part)
        judged = saved = None
        captured = part.captured
        if captured is not None:
            saving = attempted(
                lambda: writer.submit(self._save_set, part.begun, captured), Cause.STORAGE
            )
            judged = attempted(lambda: self._judged(captured, unjudged))
            if saving is not None:
                saved = attempted(saving.result, Cause.STORAGE)
        result = None if failures else attempted(lambda: self._complete(part, judged, saved))
        if result is not None:
            return result, _fault_shown_by(result), None
        error, cause = failures[0]
        fault, decided_utc = fault_of(error, cause), self._clock.now()
        result = replace(unjudged, verdict=fault.verdict, decided_utc=decided_utc)
        return replace(result, **(saved or {})), fault, error

    def _unjudged(self, part: ExposedPart) -> PartResult:
        """Result of a part before its verdict: a provisional ERROR."""
        captured = part.captured
        result = PartResult(
            station=self._station,
            exposed_utc=part.exposed_utc,
            decided_utc=self._clock.now(),
            verdict=Verdict(Decision.ERROR, "the part was not judged", (Cause.UNFORESEEN,)),
            operator=self._operator,
            software_version=SOFTWARE_VERSION,
            notes=part.notes,
            **vars(part.begun),
            **self._recipe_fields,
        )
        if captured is None:
            return result
        return replace(result, simulated=captured.metadata.simulated)

    def _judged(self, captured: CapturedSet, unjudged: PartResult) -> PartResult:
        began_s = self._clock.monotonic_s()
        result = self._inspector.inspect(captured).recorded(unjudged)
        inspect_ms = 1e3 * (self._clock.monotonic_s() - began_s)
        timings_ms = result.timings_ms | {"inspect": inspect_ms}
        return replace(result, timings_ms=timings_ms)

    def _complete(
        self, part: ExposedPart, judged: PartResult | None, saved: dict[str, Any] | None
    ) -> PartResult:
        """Return a result with all its timings; raise for values that no row can hold."""
        if judged is None or saved is None:
            raise ValueError("the part was not judged, or its set was not saved")
        timings_ms = part.timings_ms | judged.timings_ms | saved["timings_ms"]
        values = saved | {"decided_utc": self._clock.now(), "timings_ms": timings_ms}
        result = replace(judged, **values)
        # Computed here, where an error for values that cannot be stored gives the verdict ERROR.
        result.row  # noqa: B018
        return result

    def _save_set(self, part: BegunPart, captured: CapturedSet) -> dict[str, Any]:
        """Write the set; return the fields of the result that name it."""
        began_s = self._clock.monotonic_s()
        set_file = set_file_of(part.part_id, part.triggered_utc)
        self._save(captured, set_file)
        return {
            "set_file": set_file,
            "set_sha256": captured.metadata.pixels_sha256,
            "timings_ms": {"save": 1e3 * (self._clock.monotonic_s() - began_s)},
        }


def _fault_shown_by(result: PartResult) -> Fault | None:
    """Return the fault that a verdict ERROR shows."""
    # If LED levels were measured, a fault of the rig is one of its lights.
    verdict = result.verdict
    if verdict.decision is not Decision.ERROR:
        return None
    cause, levels = verdict.causes[0], result.led_levels
    if Cause.RIG not in verdict.causes or not levels:
        return Fault(cause, verdict.reason, "rig" if Cause.RIG in verdict.causes else "")
    return Fault(cause, verdict.reason, "lights", min(levels) / max(levels), STOP_LED_LEVEL)
