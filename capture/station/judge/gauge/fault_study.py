"""Which faults that nobody configured a recipe finds, and from which strength on."""

import random
from collections.abc import Iterator, Sequence
from typing import Literal

from capture.sets.captured_set import LoadedSet
from capture.station.domain.errors import RecipeError
from capture.station.domain.recipe import Recipe
from capture.station.domain.recipe_folder import RecipeFolder
from capture.station.domain.taught_files import taught_for
from capture.station.domain.verdict import Decision
from capture.station.judge.fingerprint import Fingerprint
from capture.station.judge.inspector import Inspector
from classify.base.errors import InputError
from classify.base.models import Record
from classify.confidence import CONFIDENCE, share_at_least

from .made_faults import (
    FAULTS,
    MadeFault,
    Place,
    with_fault,
)

_MIN_FOUND_SHARE = 0.9
"""Share of the parts with a fault that must not pass for it to count as found."""
_LARGE_STRENGTH = 0.2
"""Size of a large fault, as a share of the frame; a recipe must find it to be approved."""

# Number of good parts of each texture that are studied for an approval.
_PARTS = 3
_MIDDLE_SHARE = 0.25  # of the frame, within which the middle of a fault lies
_MAX_BYTES = 1 << 20


class FaultFinding(Record):
    """How many parts of a texture with a fault of one strength did not pass."""

    texture: str
    fault: str
    unit: str
    strength: float
    found: int
    parts: int

    @property
    def is_found(self) -> bool:
        """Whether at least `_MIN_FOUND_SHARE` of the parts did not pass."""
        return self.found >= _MIN_FOUND_SHARE * self.parts

    def __str__(self) -> str:
        return f"{self.fault}, {self.strength:g} {self.unit}, on {self.texture}"


class FaultStudy(Record):
    """The findings of one recipe, with hashes of all that they depend on."""

    format: Literal["ps4rig-faults"] = "ps4rig-faults"
    version: Literal[1] = 1
    fingerprint: Fingerprint
    findings: tuple[FaultFinding, ...]

    def passing(self, recipe: Recipe) -> tuple[FaultFinding, ...]:
        """Faults of `_LARGE_STRENGTH` size that pass and that a recipe does not acknowledge."""
        return tuple(
            finding
            for finding in self.findings
            if finding.unit == "of the frame"
            and finding.strength == _LARGE_STRENGTH
            and not finding.is_found
            and finding.fault not in recipe.acknowledged
        )

    def lines(self) -> list[str]:
        """From which strength on each fault is found, one line for each texture and fault."""
        lines = []
        for texture, fault in dict.fromkeys(
            (finding.texture, finding.fault) for finding in self.findings
        ):
            rows = [f for f in self.findings if (f.texture, f.fault) == (texture, fault)]
            first_found = next(
                (n for n in range(len(rows)) if all(row.is_found for row in rows[n:])), None
            )
            counts = ", ".join(f"{f.strength:g}: {f.found} of {f.parts}" for f in rows)
            outcome = f"is not found ({counts})"
            if first_found is not None:
                weakest = rows[first_found]
                fewest = min(rows[first_found:], key=lambda row: row.found / row.parts)
                found_share = share_at_least(fewest.found, fewest.parts)
                outcome = (
                    f"is found from {weakest.strength:g} {weakest.unit} on ({counts}); "
                    f"{fewest.found} of {fewest.parts} show, with {CONFIDENCE:.0%} confidence, "
                    f"that {found_share:.0%} or more are found"
                )
            lines.append(f"{texture}: {fault} {outcome}")
        return lines


def study_faults(
    files: RecipeFolder, inspector: Inspector, parts: int, *, large_only: bool = False
) -> Iterator[FaultFinding]:
    """Judge good parts that pass, at most `parts` of each texture, with each of `FAULTS`.

    With `large_only`, only faults of `_LARGE_STRENGTH`.
    """
    taught = taught_for(inspector.recipe, files)
    rng = random.Random(1)
    for texture in inspector.recipe.passes:
        good: list[tuple[LoadedSet, Inspector]] = []
        for taught_set in taught.textures[texture].sets:
            path = files.sets / taught_set.file
            if len(good) < parts and path.is_file():
                loaded = LoadedSet.of(path)
                judge = inspector.with_calibration(loaded.found_calibration)
                if judge.inspect(loaded.captured).verdict.decision is Decision.PASS:
                    good.append((loaded, judge))
        limits = inspector.recipe.limits_for(texture)
        for fault in FAULTS:
            if fault.needs_handedness and limits.handedness is None:
                continue
            for strength in fault.strengths:
                if large_only and not (fault.is_local and strength == _LARGE_STRENGTH):
                    continue
                verdicts = [_passes(judge, loaded, fault, strength, rng) for loaded, judge in good]
                judged = [verdict for verdict in verdicts if verdict is not None]
                finding = FaultFinding(
                    texture=texture,
                    fault=fault.name,
                    unit=fault.unit,
                    strength=strength,
                    found=judged.count(False),
                    parts=len(judged),
                )
                # Without a direction, a rotated piece is visible at most at its edge.
                may_pass = fault.needs_direction and not inspector.has_direction(texture)
                if judged and (finding.is_found or not may_pass):
                    yield finding


def _passes(
    inspector: Inspector, loaded: LoadedSet, fault: MadeFault, strength: float, rng: random.Random
) -> bool | None:
    """Whether a part with a fault passes; None if the lights of its set do not allow the fault."""
    rows, columns = loaded.captured.images.shape[1:]
    place = Place(
        rng.uniform(-_MIDDLE_SHARE, _MIDDLE_SHARE) * columns,
        rng.uniform(-_MIDDLE_SHARE, _MIDDLE_SHARE) * rows,
        rng.uniform(0.0, 180.0),
    )
    captured = with_fault(loaded.captured, fault, strength, place)
    if captured is None:
        return None
    return inspector.inspect(captured).verdict.decision is Decision.PASS


def _fingerprint(inspector: Inspector) -> Fingerprint:
    """Hashes without a calibration: each set is judged with its own."""
    return inspector.with_calibration(None).fingerprint


def kept_study(files: RecipeFolder, inspector: Inspector) -> FaultStudy | None:
    """The last study of exactly this recipe; None without one."""
    try:
        study = FaultStudy.read(files.faults, _MAX_BYTES, "study again")
    except InputError:
        return None
    return study if study.fingerprint == _fingerprint(inspector) else None


def keep_study(
    files: RecipeFolder, inspector: Inspector, findings: Sequence[FaultFinding]
) -> FaultStudy:
    """Write a study beside the recipe; InputError if that cannot be done."""
    study = FaultStudy(fingerprint=_fingerprint(inspector), findings=tuple(findings))
    study.write(files.faults)
    return study


def large_faults(files: RecipeFolder, inspector: Inspector) -> FaultStudy:
    """Study faults of `_LARGE_STRENGTH` size, unless a study of this recipe is kept."""
    study = kept_study(files, inspector)
    if study is None:
        findings = list(study_faults(files, inspector, _PARTS, large_only=True))
        study = keep_study(files, inspector, findings)
    return study


def require_large_faults_found(files: RecipeFolder, inspector: Inspector) -> None:
    """Check that no fault of `_LARGE_STRENGTH` size passes that the recipe does not acknowledge."""
    recipe = inspector.recipe
    passing = large_faults(files, inspector).passing(recipe)
    if passing:
        names = ", ".join(dict.fromkeys(f'"{finding.fault}"' for finding in passing))
        raise RecipeError(
            f"recipe {recipe.name}: passes parts with {'; '.join(map(str, passing))}; narrow its "
            f"limits, teach more parts, or set acknowledged = [{names}] in its file"
        )
