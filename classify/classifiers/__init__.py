"""The classifiers by name, all behind one `Classifier`.

`joint` is the default. The others are those of the thesis and of Varma and Zisserman, for
comparison.
"""

from typing import Any

from classify.base.errors import InputError

from .classifier import Classifier, Comparison, Observation, Parameters
from .joint import JOINT
from .thesis import IMAGE_POLAR, POLAR, POLAR_RADIAL, SPECTRA_2D, SPECTRA_2D_POWER
from .varma_zisserman import VARMA_ZISSERMAN

__all__ = [
    "CLASSIFIERS",
    "Classifier",
    "Comparison",
    "Observation",
    "Parameters",
    "classifier_named",
]

_ALL: tuple[Classifier[Any, Any], ...] = (
    JOINT, SPECTRA_2D, SPECTRA_2D_POWER, POLAR_RADIAL, POLAR, IMAGE_POLAR, VARMA_ZISSERMAN
)  # fmt: skip
CLASSIFIERS = {classifier.name: classifier for classifier in _ALL}


def classifier_named(name: str) -> Classifier[Any, Any]:
    """The classifier of that name; InputError if there is none."""
    if name not in CLASSIFIERS:
        raise InputError(
            f"no classifier is called {name!r}; choose one of {', '.join(CLASSIFIERS)}"
        )
    return CLASSIFIERS[name]
