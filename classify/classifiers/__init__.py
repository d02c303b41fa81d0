"""The interface of all classifiers, which library and evaluation use, and the classifiers by name.

`joint` is the default. The others are those of the thesis and of Varma and Zisserman, for
comparison.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pkgutil import resolve_name
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np

from classify.base.arrays import FloatMap, Floats
from classify.base.errors import InputError
from classify.methods import CLASSIFIERS
from classify.surface.estimate import SurfaceEstimate
from classify.texture.uniformity import Uniformity


class Observation:
    """Base class of the features of one surface: a small dataclass that pickles cheaply."""


_Test = TypeVar("_Test", bound=Observation)
_Training = TypeVar("_Training", bound=Observation)

Parameters = Mapping[str, Floats]
"""Numbers that a classifier learns from all training sets together, such as floors and weights."""

Shape = tuple[int, ...]
"""Shape of an array; -1 stands for any length."""


class Comparison(NamedTuple):
    """One signature compared with n references, as (n,) arrays."""

    distances: Floats  # 0 equal
    orientations_deg: Floats | None = None  # anticlockwise, [0, 180)
    sharpness: Floats | None = None  # of the orientation, 0 to 1
    heading_scores: Floats | None = None  # standard deviations; below 0: 180 degrees more
    blurs_px: Floats | None = None  # sigma by which the signature is blurrier; below 0: sharper


@dataclass(frozen=True)
class Classifier(Generic[_Test, _Training]):
    """A way to tell textures apart, as functions on arrays."""

    name: str
    # Features of a surface, by segments of `segment_px`.
    observe: Callable[[SurfaceEstimate, int], _Test]
    # The same for training, which may need more features than a test.
    observe_training: Callable[[SurfaceEstimate, int], _Training]
    # An array of fixed shape.
    signature: Callable[[_Test, Parameters], FloatMap]
    # (k, ...) signatures of one training set.
    references: Callable[[_Training, Parameters], FloatMap]
    # Compares a signature with (n, ...) references.
    compare: Callable[[FloatMap, FloatMap, Parameters], Comparison]
    # From the observations of all training sets and their labels.
    learn: Callable[[Sequence[_Training], Sequence[str]], Parameters] = (
        lambda _observations, _labels: {}
    )
    # From `segment_px`: the shape of each parameter.
    parameter_shapes: Callable[[int], Mapping[str, Shape]] = lambda _segment_px: {}
    # From a training observation: the `unevenness` of the set; None where it is not measured.
    unevenness: Callable[[_Training], float] | None = None
    # The distance beyond which each class rejects a set; empty for a classifier that rejects none.
    # The arguments are label and set number of each reference, the (n, ...) references, the
    # parameters, and the uniformity of each class.
    limits: Callable[
        [Sequence[str], Sequence[int], FloatMap, Parameters, Mapping[str, Uniformity]],
        dict[str, float],
    ] = lambda _labels, _sets, _references, _parameters, _uniformity: {}
    # Whether `invariants` and `bounds` let a large library skip most of its references.
    has_invariants: bool = False
    # (n, k) numbers of (n, ...) signatures that do not change with the orientation.
    invariants: Callable[[FloatMap, Parameters], FloatMap] = lambda signatures, _parameters: (
        np.ones((len(signatures), 1), np.float32)
    )
    # (n,) lower bounds of the distances, from (k,) and (n, k) invariants.
    bounds: Callable[[FloatMap, FloatMap, Parameters], Floats] = (
        lambda _test, references, _parameters: np.zeros(len(references))
    )
    # (n, 180) share of the angular structure that agrees at each orientation relative to the
    # reference; None for a classifier without orientations.
    agreement: Callable[[FloatMap, FloatMap], Floats] | None = None
    # Changes the references of a set whose orientation may be off by 180 degrees, so that they
    # give no heading.
    without_heading: Callable[[FloatMap], FloatMap] = lambda references: references
    # Whether it compares images, which depend on the lighting, rather than surfaces.
    from_images: bool = False


def simple_classifier(
    name: str,
    observe: Callable[[SurfaceEstimate, int], _Test],
    signature: Callable[[_Test, Parameters], FloatMap],
    compare: Callable[[FloatMap, FloatMap, Parameters], Comparison],
    *,
    from_images: bool = False,
) -> Classifier[_Test, _Test]:
    """Make a classifier that observes training sets like tests and learns nothing."""
    return Classifier(
        name=name,
        observe=observe,
        observe_training=observe,
        signature=signature,
        references=lambda observation, parameters: signature(observation, parameters)[None],
        compare=compare,
        from_images=from_images,
    )


def classifier_named(name: str) -> Classifier[Any, Any]:
    """The classifier of that name; InputError if there is none."""
    if name not in CLASSIFIERS:
        raise InputError(
            f"no classifier is called {name!r}; choose one of {', '.join(CLASSIFIERS)}"
        )
    classifier: Classifier[Any, Any] = resolve_name(f"{__name__}.{CLASSIFIERS[name]}")
    return classifier
