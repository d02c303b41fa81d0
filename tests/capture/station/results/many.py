"""Results of many parts, written at once: as after days of a line whose LED 2 fades."""

import random
from datetime import datetime, timedelta

from sqlalchemy import insert

from capture.base.utc_time import utc_text
from capture.station.domain.verdict import Cause, Decision, Verdict
from capture.station.results.chain import append
from capture.station.results.part_result import PartResult
from capture.station.results.schema import begun_parts, results
from capture.station.results.store import BegunPart, ResultStore

from .parts import UTC, result_of

REJECTS = (
    (0.015, Verdict(Decision.FAIL, "a scratch", (Cause.DEFECT,))),
    (0.008, Verdict(Decision.FAIL, "turned, and scratched", (Cause.ORIENTATION, Cause.DEFECT))),
    (0.006, Verdict(Decision.UNKNOWN, "like no texture", (Cause.NO_TEXTURE,))),
    (0.004, Verdict(Decision.ERROR, "LED 180 at 61 %", (Cause.RIG,))),
)
PERIOD_S = 20.0


def many(station: str, count: int, *, simulated: int = 0) -> list[PartResult]:
    """Results of parts every 20 s, so many of production and then of a simulated rig."""
    draw, begin = random.Random(7), datetime.fromisoformat(UTC)
    found = []
    for number in range(1, count + simulated + 1):
        utc = utc_text(begin + timedelta(seconds=PERIOD_S * number), timespec="milliseconds")
        begun = BegunPart(f"part-{number:06d}", number, "timer", utc, number > count)
        verdict, chance = Verdict(Decision.PASS, "it is a rock"), draw.random()
        for share, reject in REJECTS:
            chance -= share
            if chance < 0.0:
                verdict = reject
                break
        measured = {
            "label": "sand" if number % 5 == 0 else "rock",
            "distance": draw.lognormvariate(-1.0, 0.1),
            "led_levels": (1.0, draw.gauss(1.0, 0.004), 1.0 - 0.05 * number / count, 0.98),
        }
        is_measured = verdict.decision not in (Decision.UNKNOWN, Decision.ERROR)
        found.append(
            result_of(
                begun, verdict.decision, station, verdict=verdict, recipe="example",
                **(measured if is_measured else {}),
            )
        )  # fmt: skip
    return found


def fill(store: ResultStore, parts: list[PartResult]) -> None:
    """Write results and the begun parts before them, in one transaction."""

    def work(connection) -> None:
        store.lock_station(connection, UTC)
        names = BegunPart.__dataclass_fields__
        begun = [
            {"station": store.station, "request": part.part_id}
            | {name: getattr(part, name) for name in names}
            for part in parts
        ]
        connection.execute(insert(begun_parts), begun)
        append(connection, results, *(part.row for part in parts))

    store.write(work)
