"""``ps4rig rig timing``."""

from dataclasses import asdict
from typing import Annotated

import typer

from capture.base.console import new_table, out, print_json, print_table, progress, reported
from capture.commands import options


@reported
def timing(
    rig: options.Rig = "rig.toml",
    sets: Annotated[int, typer.Option(min=1, max=1000, help="Sets in each mode.")] = 5,
    as_json: options.Json = False,
) -> None:
    """Measure the time that a set and a switch of the lights take.

    Sets are captured as the rig is configured, and with a strobe by software, too. The simulated
    rig is measured in all modes, at 30 and 60 frames per second, on the virtual and on the real
    clock. A set takes at least one frame period per light and one for the ambient image.
    """
    from capture.acquisition.timing import compared_configs, measure_set_timing
    from rig.config.rig import config_of

    config = config_of(rig)
    configs = list(compared_configs(config))
    timings = [
        measure_set_timing(one, sets) for one in progress(configs, len(configs), "capturing sets")
    ]
    if as_json:
        print_json([asdict(one) for one in timings])
        return
    columns = ("Hz", "lights", "clock", "switch", "set", "worst", "in all", "limit", "rejected")
    table = new_table(*columns)
    for one in timings:
        mode = (f"{one.frame_rate_hz:.0f}", one.synchronisation, one.clock)
        sets_ms = (one.median_ms, one.worst_ms, one.exposures_ms, one.limit_ms)
        times = (_rounded(one.switch_ms, 2), *(_rounded(time_ms, 0) for time_ms in sets_ms))
        table.add_row(*mode, *times, f"{one.rejected} of {one.accepted + one.rejected}")
    print_table(table)
    out.print(
        "Times in ms. Switch: from the command or the end of exposure to the light. Set, worst: "
        "median and longest time from the request of a set to its last image. In all: from the "
        "start of the first exposure to the end of the last. Limit: one frame period per image.",
    )


def _rounded(time_ms: float | None, digits: int) -> str:
    return "-" if time_ms is None else f"{time_ms:.{digits}f}"
