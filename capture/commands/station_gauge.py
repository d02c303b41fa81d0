"""Commands that measure a station: station gauge, station bench."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from capture.base.console import out, print_json, progress
from capture.commands import options
from classify.base.errors import InputError

if TYPE_CHECKING:
    from capture.station.domain.folder import StationFolder
    from capture.station.domain.recipe_file import RecipeFolder
    from capture.station.judge.gauge import Presentation

# Largest number of taught parts per texture in the fault study. Each is judged with every simulated
# fault.
_FAULTY_PARTS = 10


_KnownPartsFile = Annotated[
    Path | None,
    typer.Option(
        help="CSV with lines ID,good and ID,bad: the known parts among the results of the "
        "station, presented as ID, ID-1, ID-2 and so on.",
        show_default="parts of the simulated rig",
        metavar="FILE.csv",
    ),
]
_Parts = Annotated[
    int,
    typer.Option(
        min=2, max=10_000, help="Number of simulated parts, if --known is not given.", metavar="N"
    ),
]
_Times = Annotated[
    int, typer.Option(min=1, max=1000, help="Presentations of each simulated part.", metavar="N")
]
_Seed = Annotated[int, typer.Option(min=0, help="Seed of the simulated placements.")]


def gauge(
    folder: options.Station,
    known: _KnownPartsFile = None,
    parts: _Parts = 20,
    times: _Times = 3,
    seed: _Seed = 1,
    json: options.Json = False,
) -> None:
    """Study the station as a gauge: known parts, each presented several times.

    The recipe is the one with which the next run begins. Effectiveness, misses and false alarms are
    reported with exact bounds, and compared with the limits of AIAG (Measurement Systems Analysis,
    4th edition): 90, 2 and 5 %. Faults that nobody configured, such as a hole or another scale, are
    simulated on taught parts: the report gives the smallest strength from which on each fault is
    found. It is kept beside the recipe, for the panel. The exit status is 1 if the rating is not
    acceptable.
    """
    from capture.station.domain.folder import StationFolder, first_recipe
    from capture.station.judge.fault_study import keep_study, study_faults
    from capture.station.judge.gauge import GaugeReport
    from capture.station.judge.inspector import Inspector
    from classify.base.durable_file import make_folder

    station = StationFolder(folder)
    files = station.recipe_files(first_recipe(station))
    if known:
        # They may come from several states of the recipe.
        recipe_sha256 = None
        presentations, is_simulated = _recorded_presentations(station, files.name, known)
    else:
        is_simulated = True
        presentations, recipe_sha256 = _simulated_presentations(station, files, parts, times, seed)
    faults: list[str] = []
    if files.file.exists():  # results may be of a recipe that was removed
        inspector = Inspector.load(files)
        findings = list(study_faults(files, inspector, _FAULTY_PARTS))
        faults = keep_study(files, inspector, findings).lines()
    report = GaugeReport.of(
        presentations,
        files.name,
        recipe_sha256,
        simulated=is_simulated,
        faults=faults,
    )
    make_folder(files.gauge.parent)
    report.write(files.gauge)
    if json:
        print_json(report.model_dump(mode="json"))
    else:
        for line in (*report.lines, *report.wrong):
            out.print(line)
    if report.rating != "acceptable":
        raise typer.Exit(1)


def _simulated_presentations(
    station: StationFolder, files: RecipeFolder, count: int, times: int, seed: int
) -> tuple[Sequence[Presentation], str]:
    """Return the presentations, and the hash of the recipe."""
    from capture.station.judge.inspector import Inspector
    from capture.station.judge.simulated_gauge import known_parts, present

    rig_config = station.rig_config()
    inspector = Inspector.load(files, rig_config.calibration)
    camera = rig_config.camera
    parts = known_parts(
        station.config.simulated_parts, count, min(camera.width_px, camera.height_px)
    )
    presented = present(parts, times, rig_config, inspector, seed)
    presentations = list(progress(presented, count * times, "present"))
    return presentations, inspector.recipe.sha256


def _recorded_presentations(
    station: StationFolder, recipe: str, known: Path
) -> tuple[Sequence[Presentation], bool]:
    """Return the presentations that a recipe judged, and whether they are of a simulated rig.

    Those of production are preferred.
    """
    from capture.station.judge.gauge import presentations_of, read_known_parts
    from capture.station.results.history import Selection
    from capture.station.results.store import open_store

    truths = read_known_parts(known)
    # Not exclusive: a running station keeps the lock of the database.
    with open_store(station.results, station.config.name, exclusive=False) as store:
        for simulated in (False, True):
            # The verdicts of the station, not those of a person who overrode them.
            entries = store.parts(Selection(simulated=simulated, recipe=recipe))
            recorded = ((entry.result.part_id, entry.result.verdict) for entry in entries)
            presentations = presentations_of(truths, recorded)
            if presentations:
                return presentations, simulated
    raise InputError(
        f"{known}: none of its {len(truths)} parts was judged by recipe {recipe}; present them to "
        "ps4rig station run --trigger enter, and enter their ids"
    )


def bench(
    parts: Annotated[int, typer.Option(min=10, max=1_000_000, help="Parts to judge.")] = 300,
    size: Annotated[int, typer.Option(min=256, max=8192, help="Side of the frames in px.")] = 1024,
    classes: Annotated[int, typer.Option(min=1, max=1000, help="Classes of the library.")] = 30,
    json: options.Json = False,
) -> None:
    """Measure how fast this machine judges parts, and whether memory grows.

    The cycle, judge, files and database are those of a station; the sets are captured before it
    starts. All files are written to the folder for temporary files, TMPDIR.
    """
    from tempfile import TemporaryDirectory

    from capture.station.run.bench import run_bench

    def print_step(step: str) -> None:
        if not json:
            out.print(f"{step} ...")

    with TemporaryDirectory() as folder:
        report = run_bench(Path(folder), parts, size, classes, print_step)
    if json:
        print_json(
            {
                "parts": len(report.latencies_ms),
                "p50_ms": report.percentile_ms(50),
                "p99_ms": report.percentile_ms(99),
                "steps_ms": report.step_percentiles_ms(50),
                "steps_p99_ms": report.step_percentiles_ms(99),
                "parts_per_minute": report.parts_per_minute,
                "memory_mb": report.memory_mb,
                "verdicts": report.decisions,
            }
        )
        return
    for line in report.lines():
        out.print(line)
