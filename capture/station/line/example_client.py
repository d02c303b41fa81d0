"""An example of a PLC's program: `python -m capture.station.line.example_client HOST PORT`.

It needs ``pip install 'ps4rig[modbus]'``.
"""

import argparse
import json
import time
from collections.abc import Callable

from .ladder import Judged, Ladder
from .modbus import PlcConnection

_SCAN_S = 0.01
_RECONNECT_S = 0.2


def run_ladder(
    host: str,
    port: int,
    next_part: Callable[[], str | None],
    judged: Callable[[Judged], None],
    recipe: int = 0,
) -> None:
    """Trigger the parts of `next_part` until it returns None, and report the verdicts.

    It reconnects without limit. Recipe 0 stands for any.
    """
    ladder = Ladder()
    ladder.recipe = recipe
    ladder.part_id = next_part()
    unjudged = int(ladder.part_id is not None)
    # A part may have its result before the PLC has seen that it may move.
    while unjudged > 0 or ladder.part_id is not None:
        try:
            with PlcConnection(host, port) as plc:
                while unjudged > 0 or ladder.part_id is not None:
                    plc.write(ladder.scan(plc.read(), time.monotonic()))
                    for part in ladder.judged:
                        judged(part)
                        unjudged -= 1
                    ladder.judged.clear()
                    if ladder.part_id is None:
                        ladder.part_id = next_part()
                        unjudged += ladder.part_id is not None
                    time.sleep(_SCAN_S)
        except ConnectionError:
            time.sleep(_RECONNECT_S)


def main() -> None:
    """Trigger parts and print a line of JSON for each."""
    parser = argparse.ArgumentParser(description="Play the PLC of a station.")
    parser.add_argument("host")
    parser.add_argument("port", type=int)
    parser.add_argument("--parts", type=int, default=10)
    parser.add_argument("--recipe", type=int, default=0, help="position of the recipe to load")
    parser.add_argument("--name", default="belt", help="beginning of the parts' ids")
    given = parser.parse_args()
    ids = (f"{given.name}-{number}" for number in range(1, given.parts + 1))
    run_ladder(
        given.host,
        given.port,
        lambda: next(ids, None),
        lambda part: print(json.dumps(vars(part)), flush=True),
        given.recipe,
    )


if __name__ == "__main__":
    main()
