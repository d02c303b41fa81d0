"""Commands that measure times: rig latency, rig timing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from capture.base.console import new_table, out, print_json, print_table, progress
from capture.commands import options

if TYPE_CHECKING:
    from rig.latency import CameraLatency


_MAX_STEPS = 1000


def latency(
    rig: options.Rig = "rig.toml",
    led: Annotated[int, typer.Option(min=0, help="The LED that is switched.")] = 0,
    steps: Annotated[
        int, typer.Option(min=5, max=_MAX_STEPS, help="Number of times it is switched on and off.")
    ] = 40,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Print the results and store nothing.")
    ] = False,
    as_json: options.Json = False,
) -> None:
    """Measure the camera's timing, and store it in rig.toml.

    It switches an LED on and off at all phases of the camera's frames, and finds each change in
    the frames. The result relates the driver's time stamps to the exposures, so that captures
    discard fewer frames. The camera must see a bright surface under the LED, and no other light
    that changes. Run it again after a change of exposure, frame rate, size or format.
    """
    from rig import ConfigError, open_rig
    from rig.config.rig import config_of, store_values
    from rig.latency import measure_latency, without_timing

    config = config_of(rig)
    if led >= len(config.lights.tilts_deg):
        raise ConfigError(
            f"--led {led}: lights.tilts_deg names {len(config.lights.tilts_deg)} LEDs"
        )
    with open_rig(without_timing(config)) as opened:
        measured = measure_latency(
            opened, led, steps, lambda numbers: progress(numbers, len(numbers), "switches")
        )
    changes: dict[str, Mapping[str, str | float]] = {"camera": measured.camera}
    if measured.settle_ms > config.lights.settle_ms:
        changes["lights"] = {"settle_ms": measured.settle_ms}
    stored = not dry_run and rig != "sim"
    if stored:
        store_values(Path(rig), changes)
    if as_json:
        print_json({**asdict(measured), "changes": changes, "stored": rig if stored else None})
        return
    _print_latency(measured, changes)
    out.print(f"stored in {rig}" if stored else "nothing was stored")


def _print_latency(
    measured: CameraLatency, changes: Mapping[str, Mapping[str, str | float]]
) -> None:
    fit = measured.fit
    table = new_table("row", "typical latency", "longest", "frames before")
    for name, row in (("first", measured.first_row), ("last", measured.last_row)):
        frames = f"up to {row.most_frames}"
        table.add_row(name, f"{row.typical_ms:.1f} ms", f"{row.most_ms:.1f} ms", frames)
    print_table(table)
    out.print(
        f"{fit.caught} frames were being exposed at one of {measured.switches} switches. The LED "
        "rises in "
        f"{1e3 * fit.rise_s:.2f} ms and falls in {1e3 * fit.fall_s:.2f} ms (10 to 90 %); it is "
        f"within a thousandth of its level after {measured.settle_ms:g} ms. Rows are read out "
        f"{'upwards' if fit.bottom_up else 'downwards'} in {1e3 * fit.readout_s:.2f} +- "
        f"{1e3 * fit.readout_error_s:.2f} ms.",
    )
    for section, values in changes.items():
        for key, value in values.items():
            out.print(f"{section}.{key} = {value}")


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
        measure_set_timing(mode_config, sets)
        for mode_config in progress(configs, len(configs), "capturing sets")
    ]
    if as_json:
        print_json([asdict(set_timing) for set_timing in timings])
        return
    columns = ("Hz", "lights", "clock", "switch", "set", "worst", "in all", "limit", "rejected")
    table = new_table(*columns)
    for row in timings:
        table.add_row(
            f"{row.frame_rate_hz:.0f}",
            row.synchronisation,
            row.clock,
            _rounded(row.switch_ms, 2),
            _rounded(row.median_ms, 0),
            _rounded(row.worst_ms, 0),
            _rounded(row.exposures_ms, 0),
            _rounded(row.limit_ms, 0),
            f"{row.rejected} of {row.accepted + row.rejected}",
        )
    print_table(table)
    out.print(
        "Times in ms. Switch: from the command or the end of exposure to the light. Set, worst: "
        "median and longest time from the request of a set to its last image. In all: from the "
        "start of the first exposure to the end of the last. Limit: one frame period per image.",
    )


def _rounded(time_ms: float | None, digits: int) -> str:
    return "-" if time_ms is None else f"{time_ms:.{digits}f}"
