"""A station that only writes results: ``python -m ... DATABASE STATION PARTS ANNOUNCED``.

It ends interrupted parts and inspects so many more. After its result, the id of each part is
appended to the file ANNOUNCED.
"""

import sys
from pathlib import Path

from capture.station.domain.verdict import Decision
from capture.station.results.part_result import PartResult
from capture.station.results.store import open_store

from .parts import inspect, result_of

if __name__ == "__main__":
    database, station, parts, announced = sys.argv[1:]
    with (
        open_store(database, station, create=True) as store,
        Path(announced).open("a", buffering=1) as said,
    ):

        def announce(result: PartResult) -> None:
            said.write(f"{result.part_id} {result.verdict.decision}\n")

        for begun in store.unfinished():
            result = result_of(begun, Decision.ERROR, station)
            store.add(result)
            announce(result)
        for _ in range(int(parts)):
            announce(inspect(store))
