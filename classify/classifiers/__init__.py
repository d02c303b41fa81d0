"""The classifiers by name, all behind one `Classifier`.

`joint` is the default. The others are those of the thesis and of Varma and Zisserman, for
comparison.
"""

from pkgutil import resolve_name
from typing import Any

from classify.base.errors import InputError
from classify.methods import CLASSIFIERS

from .classifier import Classifier, Comparison, Observation, Parameters

__all__ = ["Classifier", "Comparison", "Observation", "Parameters", "classifier_named"]


def classifier_named(name: str) -> Classifier[Any, Any]:
    """The classifier of that name; InputError if there is none."""
    if name not in CLASSIFIERS:
        raise InputError(
            f"no classifier is called {name!r}; choose one of {', '.join(CLASSIFIERS)}"
        )
    classifier: Classifier[Any, Any] = resolve_name(f"{__name__}.{CLASSIFIERS[name]}")
    return classifier
