"""Names of solvers, classifiers and texture classes, in a file that loads no numerics."""

import unicodedata
from typing import Literal, get_args

from classify.base.errors import InputError

Method = Literal[
    "ps3a", "ps3b", "ps3c", "ps3d", "ps4", "least_squares", "rushmeier", "drbohlav", "ps4_robust"
]
METHODS: tuple[Method, ...] = get_args(Method)

_MIN_LIGHTS: dict[Method, int] = {"least_squares": 3, "drbohlav": 4, "rushmeier": 5}


def default_method(lights: int) -> Method:
    """Solver of a set of that many lights if none is chosen."""
    return "ps4_robust" if lights == 4 else "least_squares"


def suits(method: Method, lights: int) -> bool:
    """Whether a solver takes that many lights; one not in the table takes four."""
    return lights >= _MIN_LIGHTS[method] if method in _MIN_LIGHTS else lights == 4


ClassifierName = Literal[
    "joint", "spectra_2d", "spectra_2d_power", "polar_radial", "polar", "image_polar",
    "varma_zisserman",
]  # fmt: skip
CLASSIFIER_NAMES: tuple[ClassifierName, ...] = get_args(ClassifierName)
DEFAULT_CLASSIFIER: ClassifierName = "joint"


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
