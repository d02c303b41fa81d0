"""`Teaching`: outcome of teaching, with overlaps and expected error rates."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from capture.station.domain.recipe import Recipe
from capture.station.domain.recipe_file import TaughtFiles
from capture.station.domain.taught import Taught
from capture.station.domain.verdict import Decision
from capture.station.judge.gauge import ACCEPTABLE
from capture.station.judge.inspector import Inspection
from classify import Match
from classify.confidence import CONFIDENCE, share_at_most, tolerance_factor, trials_to_show
from classify.library.match import MIN_MARGIN
from classify.texture.uniformity import Uniformity, uniformity_remarks

from .taught_parts import KeptSet, TaughtPart
from .teaching_limits import LimitsOf

# Largest share of bad parts that may pass, and of good parts that may be rejected.
_, _MAX_MISSES, _MAX_FALSE_ALARMS = ACCEPTABLE
# Number of good parts from which more parts hardly narrow the limits. Limits lie 10.6 standard
# deviations from the mean of 3 parts, 4.0 from that of 10 and 3.1 from that of 30
# (`classify.confidence.tolerance_factor`).
_ENOUGH_PARTS = 10


@dataclass(frozen=True)
class _Overlap:
    """Sets of a texture that match another texture, or have too small a margin to it."""

    texture: str
    other: str
    sets: tuple[KeptSet, ...]
    parts: int

    def __str__(self) -> str:
        return (
            f"{self.texture} and {self.other} overlap: {len(self.sets)} of {self.parts} parts of "
            f"{self.texture} match {self.other}, or are nearly as close to it"
        )


@dataclass(frozen=True, eq=False)
class Teaching:
    """A taught recipe, with the parts, matches and limits that it was made from."""

    recipe: Recipe
    taught: Taught
    files: TaughtFiles
    parts: tuple[TaughtPart, ...]
    # Match of each set with a library of all other sets; None if that library is empty.
    matches: tuple[Match | None, ...]
    inspections: tuple[Inspection, ...]  # by the new recipe, which was taught these sets
    # Largest share of good parts that the defect map rejects, by texture.
    false_alarm_bounds: Mapping[str, float]
    measured: LimitsOf  # the limits that were measured; people may have set others in the recipe
    teaching_remarks: tuple[str, ...]
    uniformity: Mapping[str, Uniformity]  # by texture

    @property
    def overlaps(self) -> tuple[_Overlap, ...]:
        """Pairs of textures that overlap."""
        return tuple(_overlaps([part.kept_set for part in self.parts], self.matches))

    @property
    def remarks(self) -> tuple[str, ...]:
        """Remarks for a person to check before the approval of the recipe."""
        overlaps = map(str, self.overlaps)
        classes = uniformity_remarks(self.uniformity)
        others = (*self.teaching_remarks, *self._unexpected_verdicts(), *self._few_parts())
        return (*overlaps, *classes, *others)

    def fields(self) -> dict[str, Any]:
        """Return the outcome as fields of JSON."""
        return {
            "recipe": self.recipe.name,
            "version": self.recipe.version,
            "sha256": self.recipe.sha256,
            "sets": {name: len(texture.sets) for name, texture in self.taught.textures.items()},
            "overlaps": [
                {"texture": overlap.texture, "other": overlap.other, "sets": len(overlap.sets)}
                for overlap in self.overlaps
            ],
            "uniformity": dict(self.uniformity),
            "remarks": list(self.remarks),
            "promises": list(self.promises()),
            "least_found": self.taught.least_found_fields,
            "report": str(self.files.report),
        }

    def promises(self) -> Iterator[str]:
        """Yield the error rates that the parts show, in the terms of a gauge study."""
        for texture in (*self.recipe.passes, *self.recipe.fails):
            matches = [
                match
                for part, match in zip(self.parts, self.matches, strict=True)
                if part.kept_set.texture == texture and match is not None
            ]
            if not matches:
                continue
            good = texture in self.recipe.passes
            if good:
                events = sum(match.label != texture for match in matches)
                limit, event = _MAX_FALSE_ALARMS, "rejected"
            else:
                events = sum(match.label in self.recipe.passes for match in matches)
                limit, event = _MAX_MISSES, "passed"
            kind = "good" if good else "bad"
            yield (
                f"{texture}: {events} of {len(matches)} {kind} parts were {event} by their texture "
                f"when they were left out. With {CONFIDENCE:.0%} confidence at most "
                f"{share_at_most(events, len(matches)):.1%} are; {trials_to_show(limit)} parts "
                f"without one {event} would show {limit:.0%}"
            )
        for texture, bound in self.false_alarm_bounds.items():
            yield (
                f"{texture}: the defect map rejects at most {bound:.1%} of good parts, with "
                f"{CONFIDENCE:.0%} confidence"
            )

    def least_found(self) -> Iterator[str]:
        """Yield the weakest defect that is found, for each texture, kind and size."""
        for texture, defects in self.taught.least_found.items():
            yield from (f"{texture}: {defect}" for defect in defects)

    def _few_parts(self) -> Iterator[str]:
        """Remarks on textures with fewer than `_ENOUGH_PARTS` parts that overlap or are good."""
        overlapping = [
            name for overlap in self.overlaps for name in (overlap.texture, overlap.other)
        ]
        for texture in dict.fromkeys([*overlapping, *self.recipe.passes]):
            parts = len(self.taught.textures[texture].sets)
            if parts >= _ENOUGH_PARTS:
                continue
            remark = f"{texture}: {parts} parts leave open how much it varies"
            if texture in self.recipe.passes:
                remark += (
                    f", so its limits are {tolerance_factor(parts):.1f} standard deviations wide. "
                    "A recipe that passes parts with large faults is not approved"
                )
            yield f"{remark}; teach {_ENOUGH_PARTS} parts or more"

    def _unexpected_verdicts(self) -> Iterator[str]:
        for part, inspection in zip(self.parts, self.inspections, strict=True):
            good = part.kept_set.texture in self.recipe.passes
            if good != (inspection.verdict.decision is Decision.PASS):
                verdict = inspection.verdict
                yield (
                    f"{part.kept_set}, a {'good' if good else 'bad'} part of "
                    f"{part.kept_set.texture}, is {verdict.decision}: {verdict.reason}"
                )


def _overlaps(sets: Sequence[KeptSet], matches: Sequence[Match | None]) -> Iterator[_Overlap]:
    textures = [kept_set.texture for kept_set in sets]
    pairs: dict[tuple[str, str], list[KeptSet]] = {}
    for kept_set, match in zip(sets, matches, strict=True):
        if match is None:
            continue
        other = match.nearest if match.nearest != kept_set.texture else match.runner_up
        undecided = match.margin is not None and match.margin < MIN_MARGIN
        # A texture with a single set is not in the library of all other sets.
        confused = match.nearest != kept_set.texture and textures.count(kept_set.texture) > 1
        if other is not None and (confused or undecided or match.label == other):
            pairs.setdefault((kept_set.texture, other), []).append(kept_set)
    for (texture, other), kept_sets in pairs.items():
        yield _Overlap(texture, other, tuple(kept_sets), textures.count(texture))
