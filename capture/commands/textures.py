"""Commands about textures: train, classify, evaluate."""

from __future__ import annotations

import tempfile
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from capture.base.console import complain, new_table, out, print_json, print_table, progress
from capture.base.outputs import check_output, csv_line
from classify.methods import CLASSIFIER_NAMES, DEFAULT_CLASSIFIER, METHODS, ClassifierName, Method

from . import options

if TYPE_CHECKING:
    from capture.batch.runner import Batch
    from capture.batch.tasks import ClassifiedSet
    from classify import Evaluation, TextureLibrary, Trial

_LibraryOption = Annotated[
    Path, typer.Option("--library", help="Texture library, NAME.ps4lib.", metavar="LIB")
]
_ClassifierOption = Annotated[
    ClassifierName, typer.Option(help=f"One of {', '.join(CLASSIFIER_NAMES)}.", metavar="NAME")
]


def _solver_option(sets: str, default: str) -> Any:
    """Make the option ``--method``: the solver of `sets`."""
    text = f"Solver of {sets}, one of {', '.join(METHODS)}."
    return typer.Option("--method", help=text, show_default=default, metavar="METHOD")


_TrainingSolver = Annotated[
    Method | None,
    _solver_option("all training sets", "ps4_robust for four lights, else least_squares"),
]
_LibrarySolver = Annotated[Method | None, _solver_option("the sets", "the solver of the library")]
_CsvOption = Annotated[
    Path | None,
    typer.Option("--csv", help="Write a table with a line for each set.", metavar="FILE.csv"),
]


def train(
    sets: options.Sets,
    library: _LibraryOption,
    classifier: _ClassifierOption = DEFAULT_CLASSIFIER,
    method: _TrainingSolver = None,
    calibration: options.CalibrationOfSet = None,
    force: options.Force = False,
    workers: options.Workers = None,
    scheduler: options.Scheduler = None,
    json: options.Json = False,
) -> None:
    """Train a texture library from labelled sets, any number for each class."""
    from capture.batch.runner import Batch
    from capture.batch.training import train_library
    from capture.sets.archive import find_sets
    from classify.texture.uniformity import uniformity_remarks

    paths = find_sets(sets)
    check_output(library, suffix=".ps4lib", inputs=paths, force=force)
    with Batch(workers, scheduler) as batch:
        trained, classes = train_library(
            paths, library.parent, batch, classifier, method, calibration
        )
    trained.save(library)
    if json:
        fields = ("uniformity", "method", "planar", "simulated")
        answer = {"library": str(library), "classes": classes}
        print_json(answer | {name: getattr(trained, name) for name in fields})
    else:
        simulated = " (simulated)" if trained.simulated else ""
        out.print(
            f"{library}: classes {len(classes)}, sets {len(paths)}, solved by {trained.method} as "
            f"planar parts{simulated}"
        )
        for remark in uniformity_remarks(trained.uniformity):
            out.print(remark)


def classify(
    sets: options.Sets,
    library: _LibraryOption,
    method: _LibrarySolver = None,
    calibration: options.CalibrationOfSet = None,
    csv: _CsvOption = None,
    force: options.Force = False,
    workers: options.Workers = None,
    scheduler: options.Scheduler = None,
    json: options.Json = False,
) -> None:
    """Find the texture of each set and its orientation."""
    from capture.batch.runner import Batch
    from capture.sets.archive import find_sets
    from classify.lighting import orientation_text

    paths = find_sets(sets)
    if csv is not None:
        check_output(csv, suffix=".csv", inputs=[*paths, library], force=force)
    with Batch(workers, scheduler, sets=len(paths)) as batch:
        answers, trained = _classified(paths, library, batch, method, calibration)
    if csv is not None:
        _write_csv(csv, answers, trained)
    if json:
        print_json([_record(path, answer, trained) for path, answer in answers.items()])
        return
    table = new_table(
        "set", "texture", "orientation", "distance", "limit", "reason", prose="reason"
    )
    for path, answer in answers.items():
        match, angle_deg = answer.match, answer.match.orientation_deg
        table.add_row(
            f"{path}\n(simulated)" if answer.simulated else str(path),
            match.label or "unknown",
            "-" if angle_deg is None else f"{orientation_text(angle_deg, 1)} deg",
            f"{match.distance:.4f}",
            "-" if match.limit is None else f"{match.limit:.4f}",
            match.reason,
        )
    print_table(table)


def evaluate_(
    sets: options.Sets,
    library: _LibraryOption,
    classifier: Annotated[
        ClassifierName | None,
        typer.Option(
            help="Use another classifier, trained from the training sets of the library: "
            f"{', '.join(CLASSIFIER_NAMES)}.",
            metavar="NAME",
        ),
    ] = None,
    method: _LibrarySolver = None,
    calibration: options.CalibrationOfSet = None,
    csv: _CsvOption = None,
    force: options.Force = False,
    workers: options.Workers = None,
    scheduler: options.Scheduler = None,
    json: options.Json = False,
) -> None:
    """Classify labelled sets and compare the answers with their labels.

    Sets of textures that the library was not taught are counted for themselves.
    """
    from capture.batch.runner import Batch
    from capture.batch.tasks import warn_of_sets
    from capture.sets.archive import find_sets
    from classify import evaluate

    paths = find_sets(sets)
    if csv is not None:
        check_output(csv, suffix=".csv", inputs=[*paths, library], force=force)
    # The workers of a cluster see the folder of the library, but not the temporary folder here.
    folder = None if scheduler is None else library.absolute().parent
    with (
        Batch(workers, scheduler, sets=len(paths)) as batch,
        _library_for(library, classifier, method, calibration, batch, folder) as used_library,
    ):
        answers, trained = _classified(
            paths, used_library, batch, method, calibration, label_required=True
        )
    warning = f"a training set of {library}; its result says nothing about new sets"
    warn_of_sets((path, (warning,)) for path, answer in answers.items() if answer.is_training_set)
    _warn_not_oriented(answers.values(), library, trained)
    if csv is not None:
        _write_csv(csv, answers, trained)
    trials = [_trial(answer, trained) for answer in answers.values()]
    result = evaluate(trials, trained.classes)
    if json:
        print_json(_as_json(result, answers, trained))
        return
    if result.accuracy is not None:
        _print_taught(result)
    if result.untaught:
        _print_untaught(result)


def _print_taught(result: Evaluation) -> None:
    columns = ("class", "sets", "right", "accuracy", "median error", "95 % error", "wrong answers")
    table = new_table(*columns, prose="wrong answers")
    for label, row in result.per_class.items():
        table.add_row(
            label,
            str(row.sets),
            str(row.correct),
            f"{row.accuracy:.1%}",
            _degrees(row.orientation_error_deg.median),
            _degrees(row.orientation_error_deg.p95),
            _wrong_answers(result.confusion[label], label),
        )
    print_table(table)
    errors = result.orientation_error_deg
    blur = "" if result.blur_px is None else f"; blur {result.blur_px:+.1f} px in the median"
    out.print(
        f"{result.correct} of {result.sets} right ({result.accuracy:.2%}), "
        f"{result.unknown} unknown; orientation error {_degrees(errors.median)} in the median, "
        f"{_degrees(errors.p95)} at 95 %; heading found for {result.headings}, "
        f"{result.reversed} of them reversed{blur}",
    )


def _print_untaught(result: Evaluation) -> None:
    columns = ("class not taught", "sets", "unknown", "wrongly accepted as")
    table = new_table(*columns, prose="wrongly accepted as")
    for label, answers in sorted(result.untaught.items()):
        count, unknown = sum(answers.values()), answers.get(None, 0)
        table.add_row(label, str(count), str(unknown), _wrong_answers(answers, None))
    print_table(table)
    rejected, accepted = result.untaught_rejected, result.untaught_accepted
    out.print(
        f"textures not taught: {rejected} of {rejected + accepted} sets rightly unknown, "
        f"{accepted} wrongly accepted"
    )


def _classified(
    paths: list[Path],
    library: Path,
    batch: Batch,
    method: Method | None,
    calibration: Path | None,
    *,
    label_required: bool = False,
) -> tuple[dict[Path, ClassifiedSet], TextureLibrary]:
    from capture.batch.tasks import classify_set, warn_of_sets
    from classify import TextureLibrary

    trained = TextureLibrary.load(library)  # raises its errors before the first set is read
    task = partial(
        classify_set,
        library=library.absolute(),
        label_required=label_required,
        method=method,
        calibration=None if calibration is None else calibration.absolute(),
    )
    results = batch.map(task, [path.absolute() for path in paths])
    answers = dict(zip(paths, progress(results, len(paths), "classify"), strict=True))
    warn_of_sets((path, answer.warnings) for path, answer in answers.items())
    if trained.method is None:
        solvers = " and ".join(sorted({answer.method for answer in answers.values()}))
        complain(
            f"warning: {library}: does not record the solver of its training sets; the sets were "
            f"solved by {solvers}"
        )
        return answers, trained
    remark = f"but {library} was trained with {trained.method}; textures differ between solvers"
    warn_of_sets(
        (path, (f"solved by {answer.method}, {remark}",))
        for path, answer in answers.items()
        if answer.method != trained.method
    )
    return answers, trained


def _record(path: Path, answer: ClassifiedSet, trained: TextureLibrary) -> dict[str, Any]:
    return {
        "set": str(path),
        **asdict(answer.match),
        "method": answer.method,
        "library_method": trained.method,
        "planar": answer.planar,
        "simulated": answer.simulated,
    }


@contextmanager
def _library_for(
    library: Path,
    classifier: ClassifierName | None,
    method: Method | None,
    calibration: Path | None,
    batch: Batch,
    folder: Path | None,
) -> Iterator[Path]:
    """Yield the library, or one in `folder`, trained again from its sets for `classifier`."""
    from capture.batch.training import retrain_library
    from classify import TextureLibrary

    trained = TextureLibrary.load(library)
    is_unchanged = classifier == trained.classifier and method in (None, trained.method)
    if classifier is None or is_unchanged:
        yield library
        return
    retrained = retrain_library(trained, library, batch, classifier, method, calibration)
    with tempfile.TemporaryDirectory(prefix="ps4rig-", dir=folder) as temporary:
        path = Path(temporary) / library.name
        retrained.save(path)
        yield path


def _trial(answer: ClassifiedSet, trained: TextureLibrary) -> Trial:
    from classify import Trial

    is_oriented = answer.label in trained.oriented
    return Trial(answer.label or "", answer.orientation_deg if is_oriented else None, answer.match)


def _warn_not_oriented(
    answers: Collection[ClassifiedSet], library: Path, trained: TextureLibrary
) -> None:
    labels = {answer.label for answer in answers if answer.orientation_deg is not None}
    unknown = [label for label in trained.classes if label in labels - {*trained.oriented}]
    if unknown and any(answer.match.orientation_deg is not None for answer in answers):
        complain(
            f"warning: {library}: {', '.join(unknown)}: the training sets have no orientation, so "
            "there is no orientation error; give it with ps4rig info --set orientation_deg=DEG "
            "and train again"
        )


def _write_csv(path: Path, answers: dict[Path, ClassifiedSet], trained: TextureLibrary) -> None:
    """Write a line for each set (RFC 4180); an empty cell is an unknown value."""
    from classify.base.durable_file import durable_file
    from classify.lighting import orientation_near

    rows = []
    for set_path, answer in answers.items():
        estimated_deg, true_deg = answer.match.orientation_deg, answer.orientation_deg
        error_deg = None
        if estimated_deg is not None and true_deg is not None:
            estimated_deg = round(orientation_near(estimated_deg, true_deg), 6)
            if _trial(answer, trained).orientation_error_deg is not None:
                error_deg = round(estimated_deg - true_deg, 6)
        rows.append(
            {
                "set": str(set_path),
                "true_label": answer.label,
                "true_orientation_deg": true_deg,
                **_record(set_path, answer, trained),
                "orientation_deg": estimated_deg,
                "orientation_error_deg": error_deg,
                "training_set": answer.is_training_set,
            }
        )
    with durable_file(path) as temporary:
        lines = map(csv_line, (rows[0], *(row.values() for row in rows)))
        # A file name may contain bytes that are not UTF-8.
        temporary.write_text("".join(lines), "utf-8", errors="backslashreplace", newline="")


def _wrong_answers(answers: Mapping[str | None, int], right: str | None) -> str:
    counts = (
        f"{answer or 'unknown'} {count}" for answer, count in answers.items() if answer != right
    )
    return ", ".join(counts)


def _degrees(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f} deg"


def _as_json(
    result: Evaluation, answers: dict[Path, ClassifiedSet], trained: TextureLibrary
) -> dict[str, Any]:
    return {
        "sets": result.sets,
        "accuracy": result.accuracy,
        "per_class": {
            label: {
                "sets": row.sets,
                "accuracy": row.accuracy,
                "class_uniformity": trained.uniformity.get(label),
                "orientation_error_deg": asdict(row.orientation_error_deg),
            }
            for label, row in result.per_class.items()
        },
        "confusion": _confusion(result.confusion),
        "orientation_error_deg": asdict(result.orientation_error_deg),
        "unknown": result.unknown,
        "headings": result.headings,
        "reversed": result.reversed,
        "blur_px": result.blur_px,
        "untaught": {
            "sets": result.untaught_rejected + result.untaught_accepted,
            "unknown": result.untaught_rejected,
            "accepted": result.untaught_accepted,
            "confusion": _confusion(result.untaught),
        },
        "training_sets": [str(path) for path, answer in answers.items() if answer.is_training_set],
        "methods": sorted({answer.method for answer in answers.values()}),
        "library_method": trained.method,
    }


def _confusion(counts: Mapping[str, Mapping[str | None, int]]) -> dict[str, dict[str, int]]:
    return {
        label: {answer or "unknown": count for answer, count in row.items()}
        for label, row in counts.items()
    }
