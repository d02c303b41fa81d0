"""The tables of solvers and classifiers, and names of classes, in a file that loads no numerics.

A solver or a classifier is a file in its folder and a row here.
"""

import unicodedata
from math import inf
from typing import TYPE_CHECKING, Literal, NamedTuple, TypeAlias

from classify.base.errors import InputError


class SolverRow(NamedTuple):
    """A solver: its module and function in ``classify.solvers``, and its numbers of lights."""

    function: str
    min_lights: float = 4
    max_lights: float = 4


SOLVERS = {
    "ps3a": SolverRow("linear:solve_ps3a"),
    "ps3b": SolverRow("linear:solve_ps3b"),
    "ps3c": SolverRow("linear:solve_ps3c"),
    "ps3d": SolverRow("linear:solve_ps3d"),
    "ps4": SolverRow("ps4:solve_ps4"),
    "least_squares": SolverRow("linear:solve_least_squares", 3, inf),
    "rushmeier": SolverRow("rushmeier:solve_rushmeier", 5, inf),
    "drbohlav": SolverRow("drbohlav:solve_drbohlav", 4, inf),
    "ps4_robust": SolverRow("robust:solve_ps4_robust"),
}
CLASSIFIERS = {
    "joint": "joint:JOINT",
    "spectra_2d": "thesis:SPECTRA_2D",
    "spectra_2d_power": "thesis:SPECTRA_2D_POWER",
    "polar_radial": "thesis:POLAR_RADIAL",
    "polar": "thesis:POLAR",
    "image_polar": "thesis:IMAGE_POLAR",
    "varma_zisserman": "varma_zisserman:VARMA_ZISSERMAN",
}
"""Module in ``classify.classifiers`` and object of each."""

METHODS, CLASSIFIER_NAMES = tuple(SOLVERS), tuple(CLASSIFIERS)
DEFAULT_CLASSIFIER = "joint"
if TYPE_CHECKING:  # a type checker cannot read the tables
    Method: TypeAlias = str
    ClassifierName: TypeAlias = str
else:
    Method, ClassifierName = Literal[*METHODS], Literal[*CLASSIFIER_NAMES]


def default_method(lights: int) -> Method:
    """Solver of a set of that many lights if none is chosen."""
    return "ps4_robust" if lights == 4 else "least_squares"


def suits(method: Method, lights: int) -> bool:
    """Whether a solver takes that many lights."""
    row = SOLVERS[method]
    return row.min_lights <= lights <= row.max_lights


def checked_label(label: str) -> str:
    """Return `label` if it prints and is not "unknown", the word for a surface of no class."""
    if not label.isprintable():
        raise InputError(f"label {label!r}: use printable characters only")
    if unicodedata.normalize("NFKC", label).strip().casefold() == "unknown":
        raise InputError(
            f"label {label!r}: 'unknown' stands for a surface that matches no class; "
            "choose another label"
        )
    return label
