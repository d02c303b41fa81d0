"""``ps4rig rig timing``."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated

import typer

from capture.commands import options
from capture.console import new_table, out, print_json, print_table, progress, reported

__all__ = ["timing"]


@reported
def timing(
    rig: options.Rig = "rig.toml",
    sets: Annotated[int, typer.Option(min=1, max=1000, help="Sets in each mode.")] = 5,
    as_json: options.Json = False,
) -> None:
    """Measure the time of a set and of a switch of the lights.

    Sets are captured by software and, if the rig is configured so, by the controller alone. The
    simulated rig is measured in all modes, at 30 and 60 frames per second, on the virtual and on
    the real clock. No set can take less than one frame period per image.
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
    table = new_table(
        "Hz", "lights", "clock", "switch", "set", "worst", "in all", "limit", "rejected"
    )
    for one in timings:
        table.add_row(
            f"{one.frame_rate_hz:.0f}",
            one.synchronisation,
            one.clock,
            _rounded(one.switch_ms, 2),
            *(_rounded(ms, 0) for ms in (one.median_ms, one.worst_ms, one.exposures_ms)),
            _rounded(one.limit_ms, 0),
            f"{one.rejected} of {one.accepted + one.rejected}",
        )
    print_table(table)
    out.print(
        "Times in ms. Switch: of the lights, after the command or the end of exposure. Set: from "
        "asking for it to having it, the median and the worst. In all: from the first exposure's "
        "beginning to the last one's end. Limit: a frame period for each image.",
        soft_wrap=True,
    )


def _rounded(time_ms: float | None, digits: int) -> str:
    return "-" if time_ms is None else f"{time_ms:.{digits}f}"
