"""From an exposed part to its result. Any exception on the way makes the part an ERROR."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib.metadata import version
from typing import Any, Protocol, TypeVar

from capture.sets.captured_set import CapturedSet
from capture.station.domain.errors import error_verdict
from capture.station.domain.folder import set_file_of
from capture.station.domain.verdict import Cause, Decision, Verdict
from capture.station.results.part_result import PartResult
from capture.station.results.store import BegunPart
from classify.base.threads import beside_workers

from .station_clock import StationClock

T = TypeVar("T")

_SOFTWARE_VERSION = version("ps4rig")


class Inspected(Protocol):
    """The findings of an inspector on a part."""

    @property
    def verdict(self) -> Verdict:
        """The verdict."""

    def result_fields(self) -> dict[str, Any]:
        """Fields of a `PartResult`, with the verdict."""


class PartInspector(Protocol):
    """Judges a captured set; it raises where it cannot."""

    def begin(self, unchecked: CapturedSet) -> None:
        """Start work on images that are still checked; return at once."""

    def inspect(self, captured: CapturedSet) -> Inspected:
        """Judge one part."""


@dataclass(frozen=True, eq=False)
class ExposedPart:
    """A part that needs no further exposure."""

    begun: BegunPart
    captured: CapturedSet | None
    error: BaseException | None
    exposed_s: float  # end of the last exposure, on the monotonic clock
    exposed_utc: str | None  # None if there is no set
    # ``capture``: trigger to end of exposure; ``checks``: from there on.
    timings_ms: dict[str, float]
    notes: tuple[str, ...] = ()


class PartJudge:
    """Makes the result of an exposed part."""

    def __init__(
        self,
        station: str,
        operator: str | None,
        inspector: PartInspector,
        recipe_fields: dict[str, Any],
        save: Callable[[CapturedSet, str], None],
        clock: StationClock,
    ) -> None:
        self._station, self._operator = station, operator
        self._inspector, self._recipe_fields = inspector, recipe_fields
        self._save, self._clock = save, clock

    @beside_workers()
    def result_of(
        self, part: ExposedPart, writer: ThreadPoolExecutor
    ) -> tuple[PartResult, BaseException | None]:
        """Judge a part while `writer` saves its set; return the result and any exception.

        A part passes only if its set is on disk, the inspector says so, and nothing was raised.
        """
        failures: list[tuple[BaseException, Cause | None]] = []
        if part.error is not None:
            failures.append((part.error, None))

        def tried(work: Callable[[], T], cause: Cause | None = None) -> T | None:
            try:
                return work()
            except BaseException as error:
                failures.append((error, cause))
                return None

        judged = stored = None
        captured = part.captured
        if captured is not None:
            saving = tried(lambda: writer.submit(self._stored, part, captured), Cause.STORAGE)
            judged = tried(lambda: self._judged(captured))
            if saving is not None:
                stored = tried(saving.result, Cause.STORAGE)
        fields = _joined({"timings_ms": part.timings_ms}, judged, stored)
        result = None if failures else tried(lambda: self._result(part, fields))
        if result is not None:
            return result, None
        error, cause = failures[0]
        fields = _joined({"timings_ms": {}}, stored) | {"verdict": error_verdict(error, cause)}
        return self._result(part, fields), error

    def _judged(self, captured: CapturedSet) -> dict[str, Any]:
        began_s = self._clock.monotonic_s()
        fields = self._inspector.inspect(captured).result_fields()
        return _joined(fields, self._timing("inspect", began_s))

    def _stored(self, part: ExposedPart, captured: CapturedSet) -> dict[str, Any]:
        began_s = self._clock.monotonic_s()
        set_file = set_file_of(part.begun.part_id, part.begun.triggered_utc)
        self._save(captured, set_file)
        about = {"set_file": set_file, "set_sha256": captured.metadata.pixels_sha256}
        return about | self._timing("save", began_s)

    def _timing(self, step: str, began_s: float) -> dict[str, Any]:
        return {"timings_ms": {step: 1e3 * (self._clock.monotonic_s() - began_s)}}

    def _result(self, part: ExposedPart, fields: dict[str, Any]) -> PartResult:
        captured = part.captured
        result = PartResult(
            station=self._station,
            exposed_utc=part.exposed_utc,
            decided_utc=self._clock.now(),
            operator=self._operator,
            software_version=_SOFTWARE_VERSION,
            notes=part.notes,
            **vars(part.begun)
            | {
                "simulated": part.begun.simulated
                if captured is None
                else captured.metadata.simulated
            },
            **self._recipe_fields,
            **fields,
        )
        result.row  # noqa: B018 - raises for what no row can hold
        return result


def interrupted_result(
    station: str, begun: BegunPart, decided_utc: str, stored: dict[str, Any], reason: str
) -> PartResult:
    """Return the result of a part that an earlier run began and did not end."""
    return PartResult(
        station=station,
        exposed_utc=None,
        decided_utc=decided_utc,
        operator=None,
        software_version=_SOFTWARE_VERSION,
        verdict=Verdict(Decision.ERROR, reason, (Cause.INTERRUPTED,)),
        **vars(begun),
        **stored,
    )


def _joined(*several: dict[str, Any] | None) -> dict[str, Any]:
    """Join fields; the timings are joined, too."""
    given = [fields for fields in several if fields is not None]
    joined = {name: value for fields in given for name, value in fields.items()}
    timings = [fields.get("timings_ms", {}) for fields in given]
    return joined | {"timings_ms": {step: ms for each in timings for step, ms in each.items()}}
