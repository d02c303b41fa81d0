"""Sets without a label: they become one texture only if they look like one."""

from collections.abc import Iterator, Sequence

from capture.station.domain.errors import RecipeError
from classify.library.dissimilarity import texture_groups

from .taught_part import TaughtPart

# Distance between two groups of sets, by average linkage, from which they are two textures; two
# quarters of one frame have 1. Up to 1.07 within rock, sand, malv and ogil, and 3.8 to 46 between
# two of them (4 to 16 sets, test_unlabelled.py).
_GROUP_DISTANCE = 2.0


def unlabelled_remarks(parts: Sequence[TaughtPart]) -> Iterator[str]:
    """Yield a remark if there are sets without a label."""
    if parts:
        kept_set, count = parts[0].kept_set, len(parts)
        yield (
            f"{count} set{'s' * (count != 1)} without a label, as {kept_set}: taught as "
            f"{kept_set.texture}; --label TEXTURE names another one"
        )


def require_one_texture(parts: Sequence[TaughtPart]) -> None:
    """Check that sets without a label look alike."""
    if len(parts) < 2:
        return
    rows, tests = (
        [part.training_row for part in parts],
        [part.matching_observation for part in parts],
    )
    groups = texture_groups(rows, tests, parts[0].segment_px, _GROUP_DISTANCE)
    firsts = [groups.index(group) for group in sorted(set(groups))]
    if len(firsts) > 1:
        named = ", ".join(
            f"{groups.count(groups[first])} like {parts[first].kept_set}" for first in firsts
        )
        raise RecipeError(
            f"{len(parts)} sets have no label, and look like {len(firsts)} textures: {named}; "
            "teach each with --label TEXTURE"
        )
