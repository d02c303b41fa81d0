"""Sets without a label: they become one texture only if they look like one."""

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.cluster import hierarchy
from scipy.spatial.distance import squareform

from capture.station.domain.errors import RecipeError
from classify import TextureLibrary
from classify.classifiers import classifier_named

from .taught_part import TaughtPart

# Distance between two groups of sets, by average linkage, from which they are two textures; two
# quarters of one frame have 1. Up to 1.07 within rock, sand, malv and ogil, and 3.8 to 46 between
# two of them (4 to 16 sets, test_unlabelled.py).
_APART = 2.0


def unlabelled_remarks(parts: Sequence[TaughtPart]) -> Iterator[str]:
    """Yield a remark if there are sets without a label."""
    if parts:
        kept, count = parts[0].kept, len(parts)
        yield (
            f"{count} set{'s' * (count != 1)} without a label, as {kept.path.name}: taught as "
            f"{kept.texture}; --label TEXTURE names another one"
        )


def require_one_texture(parts: Sequence[TaughtPart]) -> None:
    """Check that sets without a label look alike."""
    if len(parts) < 2:
        return
    groups = _groups(parts)
    firsts = [groups.index(group) for group in sorted(set(groups))]
    if len(firsts) > 1:
        named = ", ".join(
            f"{groups.count(groups[first])} like {parts[first].kept.path.name}" for first in firsts
        )
        raise RecipeError(
            f"{len(parts)} sets have no label, and look like {len(firsts)} textures: {named}; "
            "teach each with --label TEXTURE"
        )


def _groups(parts: Sequence[TaughtPart]) -> list[int]:
    """The group of each part, by average linkage of their distances."""
    names = [str(number) for number in range(len(parts))]
    rows = [part.row._replace(label=name) for part, name in zip(parts, names, strict=True)]
    library = TextureLibrary.from_observations(rows, parts[0].segment_px)
    classifier, labels = classifier_named(library.classifier), np.array(library.labels)
    distances = np.empty((len(parts), len(parts)))
    for number, part in enumerate(parts):
        signature = classifier.signature(part.test, library.parameters)
        found = classifier.compare(signature, library.signatures, library.parameters).distances
        distances[number] = [found[labels == name].min() for name in names]
    both_ways = 0.5 * (distances + distances.T)
    np.fill_diagonal(both_ways, 0.0)
    tree = hierarchy.linkage(squareform(both_ways), method="average")
    return [int(group) for group in hierarchy.fcluster(tree, _APART, "distance")]
