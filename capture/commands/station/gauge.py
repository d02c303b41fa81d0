"""``ps4rig station gauge``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from capture.commands import options
from capture.console import out, print_json, progress, reported

from .teach import Station

if TYPE_CHECKING:
    from capture.station.folder import StationFolder
    from capture.station.gauge import GaugeStudy, Presentation, Share


@reported
def gauge(
    folder: Station,
    known: Annotated[
        Path | None,
        typer.Option(
            help="CSV with lines ID,good and ID,bad: the known parts among the results of the "
            "station, presented as ID, ID-1, ID-2 and so on.",
            show_default="parts of the simulated rig",
            metavar="FILE.csv",
        ),
    ] = None,
    parts: Annotated[
        int, typer.Option(min=2, max=10_000, help="Known parts of the simulated rig.", metavar="N")
    ] = 20,
    times: Annotated[
        int, typer.Option(min=1, max=1000, help="Presentations of each of them.", metavar="N")
    ] = 3,
    seed: Annotated[int, typer.Option(min=0, help="Seed of their placements.")] = 1,
    json: options.Json = False,
) -> None:
    """Study the station as a gauge: known parts, each presented several times.

    Effectiveness, misses and false alarms with exact bounds, against the 90, 2 and 5 % of AIAG. The
    exit status is 1 if they are not acceptable.
    """
    from capture.station.folder import StationFolder
    from capture.station.gauge import GaugeStudy

    station = StationFolder(folder)
    found = _recorded(station, known) if known else _presented(station, parts, times, seed)
    study = GaugeStudy(tuple(found))
    if json:
        print_json(_as_json(study))
    else:
        for line in (*study.lines(), *study.wrong()):
            out.print(line, soft_wrap=True)
    if study.rating != "acceptable":
        raise typer.Exit(1)


def _presented(station: StationFolder, count: int, times: int, seed: int) -> list[Presentation]:
    from capture.station.inspector import Inspector
    from capture.station.simulated_gauge import known_parts, present
    from rig.config.rig import config_of

    rig_config = config_of(station.config.rig_in(station.path))
    calibration = rig_config.calibration
    inspector = Inspector.load(
        station.recipe_files(), None if calibration is None else Path(calibration)
    )
    camera = rig_config.camera
    shown = known_parts(
        station.config.simulated_parts, count, min(camera.width_px, camera.height_px)
    )
    found = present(shown, times, rig_config, inspector, seed)
    return list(progress(found, count * times, "present"))


def _recorded(station: StationFolder, known: Path) -> list[Presentation]:
    from capture.station.gauge import presentations_of, read_known_parts
    from capture.station.results.store import open_store
    from classify.errors import InputError

    truths = read_known_parts(known)
    config = station.config
    with open_store(config.results_in(station.path), config.name, alone=False) as store:
        # The verdicts of the station, not those of a person who overrode them.
        recorded = ((entry.result.part_id, entry.result.verdict) for entry in store.parts())
        found = presentations_of(truths, recorded)
    if not found:
        raise InputError(
            f"{known}: none of its {len(truths)} parts is among the results; present them to "
            "ps4rig station run --trigger enter, and enter their ids"
        )
    return list(found)


def _as_json(study: GaugeStudy) -> dict[str, object]:
    def share(found: Share) -> dict[str, float | int | None]:
        return {
            "events": found.events,
            "trials": found.trials,
            "share": found.value,
            "bound": found.bound,
        }

    return {
        "presentations": len(study.presentations),
        "effectiveness": share(study.effectiveness),
        "misses": share(study.misses),
        "false_alarms": share(study.false_alarms),
        "rating": study.rating,
        "wrong": study.wrong(),
    }
