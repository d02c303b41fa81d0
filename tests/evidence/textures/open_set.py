"""Matches of test patches with libraries that lack their class, and counts of answers."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from capture.chapter.plan import BEST_SOLVER, OURS, THESIS
from capture.chapter.runs import PatchTask, System, load_library, patch_matches
from classify import Match, TextureLibrary, Trial
from classify.classifiers import classifier_named

from .plan import OpenSetRun


class Outcome(NamedTuple):
    """Result of one patch with one system."""

    system: System
    trial: Trial
    match_without_class: Match | None  # only for an `OpenSetRun`


def match_patch(task: PatchTask) -> list[Outcome]:
    """Match one patch with all libraries, with and without its class."""
    outcomes = []
    for known in patch_matches(task):
        unknown, system = None, known.system
        is_compared = system.solver == BEST_SOLVER and system.classifier in (OURS, THESIS)
        if is_compared and isinstance(known.run, OpenSetRun):
            library = _load_without_class(known.library, task.texture.name)
            unknown = library.match(known.signature)
        outcomes.append(Outcome(system, known.trial, unknown))
    return outcomes


@lru_cache(maxsize=64)
def _load_without_class(path: Path, label: str) -> TextureLibrary:
    return without_class(load_library(path), label)


def without_class(library: TextureLibrary, label: str) -> TextureLibrary:
    """Remove a class from the references and limits; parameters learned from all classes stay.

    References of one class and orientation are taken as one set.
    """
    kept = [index for index, other in enumerate(library.labels) if other != label]
    labels = tuple(library.labels[index] for index in kept)
    orientations_deg, signatures = library.orientations_deg[kept], library.signatures[kept]
    numbers: dict[tuple[str, float], int] = {}
    sets = [
        numbers.setdefault(key, len(numbers))
        for key in zip(labels, orientations_deg.tolist(), strict=True)
    ]
    limits = classifier_named(library.classifier).limits(
        labels, sets, signatures, library.parameters, library.uniformity
    )
    return replace(
        library,
        labels=labels,
        orientations_deg=orientations_deg,
        signatures=signatures,
        limits=limits,
    )


class Answers(NamedTuple):
    """Percent of tests on known textures: right, refused, wrong; unknown accepted."""

    right: float
    refused: float
    wrong: float
    accepted: float


def answers_pct(outcomes: Sequence[Outcome]) -> Answers:
    """Count the answers by the limits in the library, with and without the class of the test."""
    labels = [(outcome.trial.label, outcome.trial.match.label) for outcome in outcomes]
    unknown = [match for outcome in outcomes if (match := outcome.match_without_class)]
    return Answers(
        right=_share_pct(answer == true for true, answer in labels),
        refused=_share_pct(answer is None for _, answer in labels),
        wrong=_share_pct(answer not in (true, None) for true, answer in labels),
        accepted=_share_pct(match.label is not None for match in unknown),
    )


def _share_pct(answers: Iterable[bool]) -> float:
    return 100.0 * float(np.mean(list(answers)))
