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

from capture.console import new_table, out, print_json, print_table, progress, reported
from capture.outputs import check_output
from classify.errors import InputError
from classify.methods import CLASSIFIER_NAMES, DEFAULT_CLASSIFIER

from . import options

if TYPE_CHECKING:
    from capture.batch.runner import Batch
    from capture.batch.tasks import ClassifiedSet
    from classify import Evaluation

LibraryOption = Annotated[
    Path, typer.Option("--library", help="Texture library, NAME.ps4lib.", metavar="LIB")
]
ClassifierOption = Annotated[
    str, typer.Option(help=f"One of {', '.join(CLASSIFIER_NAMES)}.", metavar="NAME")
]


@reported
def train(
    sets: options.Sets,
    library: LibraryOption,
    classifier: ClassifierOption = DEFAULT_CLASSIFIER,
    force: options.Force = False,
    workers: options.Workers = None,
    scheduler: options.Scheduler = None,
    json: options.Json = False,
) -> None:
    """Train a texture library from labelled sets, any number for each class."""
    from capture.batch.runner import Batch
    from capture.batch.training import train_library
    from capture.sets.archive import find_sets

    paths = find_sets(sets)
    check_output(library, suffix=".ps4lib", inputs=paths, force=force)
    _check_classifier(classifier)
    with Batch(workers, scheduler) as batch:
        trained, classes = train_library(paths, library.parent, batch, classifier)
    trained.save(library)
    if json:
        about = {"classes": classes, "planar": trained.planar, "simulated": trained.simulated}
        print_json({"library": str(library), **about})
    else:
        note = " (simulated)" if trained.simulated else ""
        parts = f"{len(paths)} sets, solved as planar parts"
        out.print(f"{library}: {len(classes)} classes from {parts}{note}", soft_wrap=True)


@reported
def classify(
    sets: options.Sets,
    library: LibraryOption,
    workers: options.Workers = None,
    scheduler: options.Scheduler = None,
    json: options.Json = False,
) -> None:
    """Find the texture of each set and its orientation."""
    from capture.batch.runner import Batch
    from capture.sets.archive import find_sets

    paths = find_sets(sets)
    with Batch(workers, scheduler) as batch:
        answers = _classified(paths, library, batch)
    if json:
        fields = (
            asdict(each.match) | {"planar": each.planar, "simulated": each.simulated}
            for each in answers
        )
        print_json([{"set": str(path), **own} for path, own in zip(paths, fields, strict=True)])
        return
    columns = ("set", "texture", "orientation", "distance", "limit", "reason")
    table = new_table(*columns, prose="reason")
    for path, each in zip(paths, answers, strict=True):
        match = each.match
        name = f"{path}\n(simulated)" if each.simulated else str(path)
        limit = "-" if match.limit is None else f"{match.limit:.4f}"
        found = (match.label or "unknown", _degrees(match.orientation_deg, 1))
        table.add_row(name, *found, f"{match.distance:.4f}", limit, match.reason)
    print_table(table)


@reported
def evaluate_(
    sets: options.Sets,
    library: LibraryOption,
    classifier: Annotated[
        str | None,
        typer.Option(
            help="Use another classifier, trained from the training sets of the library: "
            f"{', '.join(CLASSIFIER_NAMES)}.",
            metavar="NAME",
        ),
    ] = None,
    workers: options.Workers = None,
    scheduler: options.Scheduler = None,
    json: options.Json = False,
) -> None:
    """Classify labelled sets and compare the answers with their labels."""
    from capture.batch.runner import Batch
    from capture.sets.archive import find_sets
    from classify import Trial, evaluate

    paths = find_sets(sets)
    # The workers of a cluster see the folder of the library, but not the temporary folder here.
    folder = None if scheduler is None else library.absolute().parent
    with (
        Batch(workers, scheduler) as batch,
        _library_for(library, classifier, batch, folder) as chosen,
    ):
        answers = _classified(paths, chosen, batch, label_required=True)
    trials = [Trial(answer.label or "", answer.orientation_deg, answer.match) for answer in answers]
    result = evaluate(trials)
    if json:
        print_json(_as_json(result))
        return
    columns = ("class", "sets", "right", "accuracy", "median error", "95 % error", "wrong answers")
    table = new_table(*columns, prose="wrong answers")
    for label, row in result.per_class.items():
        errors = row.orientation_error_deg
        counts = result.confusion[label].items()
        wrong = [f"{answer or 'unknown'} {count}" for answer, count in counts if answer != label]
        shares = (str(row.sets), str(row.correct), f"{row.accuracy:.1%}")
        degrees = (_degrees(errors.median, 2), _degrees(errors.p95, 2))
        table.add_row(label, *shares, *degrees, ", ".join(wrong))
    print_table(table)
    errors = result.orientation_error_deg
    out.print(
        f"{result.correct} of {result.sets} right ({result.accuracy:.2%}), "
        f"{result.unknown} unknown; orientation error {_degrees(errors.median, 2)} in the median, "
        f"{_degrees(errors.p95, 2)} at 95 %; heading found for {result.headings}, "
        f"{result.reversed} of them reversed",
        soft_wrap=True,
    )


def _classified(
    paths: list[Path], library: Path, batch: Batch, label_required: bool = False
) -> list[ClassifiedSet]:
    from capture.batch.tasks import classify_set, warn_unprotected
    from classify import TextureLibrary

    TextureLibrary.load(library)  # so that a wrong library is found before the first set
    task = partial(classify_set, library=library.absolute(), label_required=label_required)
    answers = batch.map(task, [path.absolute() for path in paths])
    answered = list(progress(answers, len(paths), "classify"))
    warn_unprotected((path, answer.protected) for path, answer in zip(paths, answered, strict=True))
    return answered


def _check_classifier(name: str) -> None:
    if name not in CLASSIFIER_NAMES:
        raise InputError(f"--classifier {name}: choose one of {', '.join(CLASSIFIER_NAMES)}")


@contextmanager
def _library_for(
    library: Path, classifier: str | None, batch: Batch, folder: Path | None
) -> Iterator[Path]:
    """Yield the library, or a temporary one in `folder` with `classifier` and the same sets."""
    from capture.batch.training import retrain_library
    from classify import TextureLibrary

    if classifier is not None:
        _check_classifier(classifier)
    trained = TextureLibrary.load(library)
    if classifier in (None, trained.classifier):
        yield library
        return
    retrained = retrain_library(trained, library, batch, classifier)
    with tempfile.TemporaryDirectory(prefix="ps4rig-", dir=folder) as temporary:
        path = Path(temporary) / library.name
        retrained.save(path)
        yield path


def _degrees(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f} deg"


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
