"""Commands about textures: train, classify, evaluate."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from capture.console import (
    JsonOption,
    SchedulerOption,
    SetsArgument,
    WorkersOption,
    folding_table,
    out,
    print_json,
    progress,
    reported,
)
from classify.errors import InputError
from classify.methods import CLASSIFIER_NAMES, DEFAULT_CLASSIFIER

if TYPE_CHECKING:
    from capture.batch.tasks import ClassifiedSet
    from classify import Evaluation

__all__ = ["classify", "evaluate_", "train"]

LibraryOption = Annotated[
    Path, typer.Option("--library", help="Texture library, NAME.ps4lib.", metavar="LIB")
]

ClassifierOption = Annotated[
    str,
    typer.Option(help=f"How textures are compared: {', '.join(CLASSIFIER_NAMES)}.", metavar="NAME"),
]


@reported
def train(
    sets: SetsArgument,
    library: LibraryOption,
    classifier: ClassifierOption = DEFAULT_CLASSIFIER,
    workers: WorkersOption = None,
    scheduler: SchedulerOption = None,
    json: JsonOption = False,
) -> None:
    """Learn textures from labelled sets, any number per class."""
    from capture.sets.archive import find_sets
    from capture.training import train_library
    from classify.library.ps4lib import check_path

    check_path(library)
    paths = find_sets(sets)
    trained, classes = train_library(
        paths, library.parent, _known(classifier), workers=workers, scheduler=scheduler
    )
    trained.save(library)
    simulated = trained.simulated
    if json:
        print_json({"library": str(library), "classes": classes, "simulated": simulated})
    else:
        note = " (simulated)" if simulated else ""
        out.print(f"{library}: {len(classes)} classes from {len(paths)} sets{note}", soft_wrap=True)


@reported
def classify(
    sets: SetsArgument,
    library: LibraryOption,
    workers: WorkersOption = None,
    scheduler: SchedulerOption = None,
    json: JsonOption = False,
) -> None:
    """Say which texture each set shows, and how far it is turned."""
    from capture.sets.archive import find_sets

    paths = find_sets(sets)
    answers = _classified(paths, library, workers, scheduler)
    results = [
        {"set": str(path), **asdict(answer.match), "simulated": answer.simulated}
        for path, answer in zip(paths, answers, strict=True)
    ]
    if json:
        print_json(results)
        return
    table = folding_table("set", "texture", "angle", "distance", "runner-up", "margin")
    for row in results:
        table.add_row(
            row["set"] + (" (simulated)" if row["simulated"] else ""),
            row["label"] or "unknown",
            "-" if row["orientation_deg"] is None else f"{row['orientation_deg']:.1f}°",
            f"{row['distance']:.4f}",
            row["runner_up"] or "-",
            "-" if row["margin"] is None else f"{row['margin']:.2f}",
        )
    out.print(table)


@reported
def evaluate_(
    sets: SetsArgument,
    library: LibraryOption,
    classifier: Annotated[
        str | None,
        typer.Option(
            help="Ask another classifier, which learns from the sets that the library was trained "
            f"from: {', '.join(CLASSIFIER_NAMES)}.",
            metavar="NAME",
        ),
    ] = None,
    workers: WorkersOption = None,
    scheduler: SchedulerOption = None,
    json: JsonOption = False,
) -> None:
    """Classify labelled sets, all those below a folder, and compare with their labels."""
    from capture.sets.archive import find_sets
    from classify import Trial, evaluate

    paths = find_sets(sets)
    with _library_for(library, classifier, workers, scheduler) as asked:
        answers = _classified(paths, asked, workers, scheduler, label_required=True)
    trials = [Trial(answer.label or "", answer.orientation_deg, answer.match) for answer in answers]
    result = evaluate(trials)
    if json:
        print_json(_as_json(result))
        return
    table = folding_table("class", "sets", "right", "accuracy", "angle error", "95 %", "taken for")
    for label, row in result.per_class.items():
        errors = row.orientation_error_deg
        others = {
            answer or "unknown": count
            for answer, count in result.confusion[label].items()
            if answer != label
        }
        table.add_row(
            label,
            str(row.sets),
            str(row.correct),
            f"{row.accuracy:.1%}",
            _degrees(errors.median),
            _degrees(errors.p95),
            ", ".join(f"{answer} {count}" for answer, count in others.items()),
        )
    out.print(table)
    errors = result.orientation_error_deg
    out.print(
        f"{result.correct} of {result.sets} right ({result.accuracy:.2%}), "
        f"{result.unknown} unknown; angle error {_degrees(errors.median)} median, "
        f"{_degrees(errors.p95)} at 95 %; heading told of {result.headings}, "
        f"{result.reversed} of them reversed"
    )


def _classified(
    paths: list[Path],
    library: Path,
    workers: int | None,
    scheduler: str | None,
    label_required: bool = False,
) -> list[ClassifiedSet]:
    from capture.batch.runner import Batch
    from capture.batch.tasks import classify_set
    from classify import TextureLibrary

    TextureLibrary.load(library)  # once here, so that what is wrong with it is said at once
    task = partial(classify_set, library=library.absolute(), label_required=label_required)
    with Batch(workers, scheduler) as batch:
        answers = batch.map(task, [path.absolute() for path in paths])
        return list(progress(answers, len(paths), "classify"))


def _known(classifier: str) -> str:
    if classifier not in CLASSIFIER_NAMES:
        raise InputError(f"--classifier {classifier}: choose one of {', '.join(CLASSIFIER_NAMES)}")
    return classifier


@contextmanager
def _library_for(
    library: Path, classifier: str | None, workers: int | None, scheduler: str | None
) -> Iterator[Path]:
    """The library itself, or one of the same sets for another classifier, for as long as asked."""
    from capture.training import train_again
    from classify import TextureLibrary

    if classifier is None or TextureLibrary.load(library).classifier == _known(classifier):
        yield library
        return
    trained = train_again(
        TextureLibrary.load(library), library, classifier, workers=workers, scheduler=scheduler
    )
    # The workers of a cluster see the folder of the library, but not this machine's own.
    shared = None if scheduler is None else library.absolute().parent
    with tempfile.TemporaryDirectory(prefix="ps4rig-", dir=shared) as folder:
        path = Path(folder) / library.name
        trained.save(path)
        yield path


def _degrees(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}°"


def _as_json(result: Evaluation) -> dict[str, Any]:
    return {
        "sets": result.sets,
        "accuracy": result.accuracy,
        "per_class": {
            label: {
                "sets": row.sets,
                "accuracy": row.accuracy,
                "orientation_error_deg": asdict(row.orientation_error_deg),
            }
            for label, row in result.per_class.items()
        },
        "confusion": {
            label: {answer or "unknown": count for answer, count in row.items()}
            for label, row in result.confusion.items()
        },
        "orientation_error_deg": asdict(result.orientation_error_deg),
        "unknown": result.unknown,
        "headings": result.headings,
        "reversed": result.reversed,
    }
