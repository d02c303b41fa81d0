"""Commands about textures: train, classify, evaluate."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated, Any

import typer

from classify import Evaluation, SurfaceEstimate, TextureLibrary, Trial, evaluate
from classify.errors import InputError
from classify.library_file import check_path

from .captured_set import CapturedSet
from .console import JsonOption, folding_table, naming, out, print_json, progress, reported
from .set_file import SUFFIX

__all__ = ["classify", "evaluate_", "train"]

SetsArgument = Annotated[list[Path], typer.Argument(metavar="SET...", help="Captured sets.")]
LibraryOption = Annotated[
    Path, typer.Option("--library", help="Texture library, NAME.ps4lib.", metavar="LIB")
]


@reported
def train(sets: SetsArgument, library: LibraryOption, json: JsonOption = False) -> None:
    """Learn textures from labelled sets, any number per class."""
    check_path(library)
    simulated = False

    def samples() -> Iterator[tuple[str, SurfaceEstimate, float | None]]:
        nonlocal simulated
        for path, captured in _loaded(sets, "train"):
            simulated |= captured.metadata.simulated
            with naming(path):
                surface = captured.solve()
            yield _label(path, captured), surface, captured.metadata.orientation_deg

    trained = replace(TextureLibrary.train(samples()), simulated=simulated)
    trained.save(library)
    classes = {
        label: sum(reference.label == label for reference in trained.references)
        for label in trained.labels
    }
    if json:
        print_json({"library": str(library), "classes": classes, "simulated": simulated})
    else:
        note = " (simulated)" if simulated else ""
        out.print(f"{library}: {len(classes)} classes from {len(sets)} sets{note}", soft_wrap=True)


@reported
def classify(sets: SetsArgument, library: LibraryOption, json: JsonOption = False) -> None:
    """Say which texture each set shows, and how far it is turned."""
    trained = TextureLibrary.load(library)
    results = []
    for path, captured in _loaded(sets, "classify"):
        with naming(path):
            match = trained.classify(captured.solve())
        results.append(
            {"set": str(path), **asdict(match), "simulated": captured.metadata.simulated}
        )
    if json:
        print_json(results)
        return
    table = folding_table("set", "texture", "angle", "distance", "runner-up", "margin")
    for row in results:
        table.add_row(
            row["set"] + (" (simulated)" if row["simulated"] else ""),
            row["label"] or "unknown",
            f"{row['orientation_deg']:.1f}°",
            f"{row['distance']:.4f}",
            row["runner_up"] or "-",
            "-" if row["margin"] is None else f"{row['margin']:.2f}",
        )
    out.print(table)


@reported
def evaluate_(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of labelled sets.")],
    library: LibraryOption,
    json: JsonOption = False,
) -> None:
    """Classify every labelled set below a folder and compare with the labels."""
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder")
    paths = sorted(folder.rglob(f"*{SUFFIX}"))
    if not paths:
        raise InputError(f"{folder}: holds no captured sets (*{SUFFIX})")
    trained = TextureLibrary.load(library)
    trials = []
    for path, captured in _loaded(paths, "evaluate"):
        with naming(path):
            match = trained.classify(captured.solve())
        trials.append(Trial(_label(path, captured), captured.metadata.orientation_deg, match))
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
        f"{_degrees(errors.p95)} at 95 %"
    )


def _loaded(paths: Sequence[Path], what: str) -> Iterator[tuple[Path, CapturedSet]]:
    for path in progress(paths, len(paths), what):
        yield path, CapturedSet.load(path)


def _label(path: Path, captured: CapturedSet) -> str:
    if not captured.label:
        raise InputError(f"{path}: has no label; capture or import it with --label")
    return captured.label


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
    }
