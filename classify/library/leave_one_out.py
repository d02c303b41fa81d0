"""Match every training set with a library of all others."""

from collections.abc import Sequence

from classify.classifiers import Observation, classifier_named
from classify.methods import DEFAULT_CLASSIFIER

from .match import Match
from .texture_library import TextureLibrary
from .training import TrainingRow


def leave_one_out(
    rows: Sequence[TrainingRow],
    tests: Sequence[Observation],
    segment_px: int,
    classifier: str = DEFAULT_CLASSIFIER,
    rounds: int = 30,
) -> list[Match | None]:
    """Return the match of each set with a library that was not trained on it.

    More than `rounds` sets are left out in groups; a match is None where no set is left.
    """
    named = classifier_named(classifier)
    # Sets of one class are neighbours in `rows`, so that they come into different groups.
    groups = [number % rounds for number in range(len(rows))]
    matches: dict[int, Match | None] = {}
    for group in range(min(rounds, len(rows))):
        others = [row for row, other in zip(rows, groups, strict=True) if other != group]
        library = None
        if others:
            library = TextureLibrary.from_observations(others, segment_px, classifier)
        for number in range(group, len(rows), rounds):
            match = None
            if library is not None:
                match = library.match(named.signature(tests[number], library.parameters))
            matches[number] = match
    return [matches[number] for number in range(len(rows))]
