"""Replay the challenge set of a recipe, which a recipe must meet before it runs."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Literal

from capture.base.console import ShowProgress, progress
from capture.base.utc_time import utc_text
from capture.sets.captured_set import CapturedSet
from capture.station.domain.errors import ChallengeFailed
from capture.station.domain.fault import fault_of
from capture.station.domain.recipe_file import RecipeFolder, file_sha256
from capture.station.domain.verdict import Decision, Verdict
from classify.base.errors import InputError
from classify.base.models import Record

from .challenge_set import MAX_SETS, Expected, read_challenge
from .fingerprint import Fingerprint
from .inspector import Inspector

# Largest replay: 10,000 parts take 600 bytes each.
_MAX_BYTES = 1 << 23


class PartOutcome(Record):
    """The verdict on a part of a challenge, and the one that it must get."""

    file: str
    file_sha256: str | None = None  # both hashes are None if the file could not be read
    pixels_sha256: str | None
    expected: Expected
    found: Decision
    reason: str

    @property
    def is_regression(self) -> bool:
        """Whether the verdict differs from the expected one, or the set could not be read."""
        if self.expected == "reject":
            return self.found is Decision.PASS or self.pixels_sha256 is None
        return self.found != self.expected

    def __str__(self) -> str:
        return f"{self.file} must be {self.expected} and is {self.found}: {self.reason}"


class Replay(Record):
    """The outcome of a replay, with hashes of everything that the verdicts depend on."""

    format: Literal["ps4rig-challenge"] = "ps4rig-challenge"
    version: Literal[1] = 1
    utc: str
    fingerprint: Fingerprint
    parts: tuple[PartOutcome, ...]

    @property
    def regressions(self) -> tuple[PartOutcome, ...]:
        """Parts whose verdict differs from the expected one."""
        return tuple(part for part in self.parts if part.is_regression)


def replay_challenge(
    files: RecipeFolder, inspector: Inspector, raise_if_cancelled: Callable[[], None] = lambda: None
) -> Iterator[PartOutcome]:
    """Judge every part of the challenge with the present calibration.

    `raise_if_cancelled` is called before each part.
    """
    for file, expected in read_challenge(files.challenge).sets.items():
        raise_if_cancelled()
        path = files.challenge / file
        # Hashed before the set is read: if a set is exchanged in between, the hash does not match,
        # and the challenge is replayed again.
        sha256 = _sha256(path)
        verdict, pixels_sha256 = _verdict_on(path, inspector)
        yield PartOutcome(
            file=file,
            file_sha256=sha256,
            pixels_sha256=pixels_sha256,
            expected=expected,
            found=verdict.decision,
            reason=verdict.reason,
        )


def run_challenge(
    files: RecipeFolder, inspector: Inspector, show: ShowProgress = progress
) -> Replay:
    """Judge every part of the challenge, and keep the outcome."""
    total = len(read_challenge(files.challenge).sets)
    parts = tuple(show(replay_challenge(files, inspector), total, "replay"))
    return _keep_replay(files, inspector, parts)


def _keep_replay(
    files: RecipeFolder, inspector: Inspector, parts: tuple[PartOutcome, ...]
) -> Replay:
    """Write the outcome of a replay; raises InputError if that cannot be done."""
    replay = Replay(utc=utc_text(), fingerprint=inspector.fingerprint, parts=parts)
    replay.write(files.replay)
    return replay


def require_challenge(
    files: RecipeFolder, inspector: Inspector, raise_if_cancelled: Callable[[], None] = lambda: None
) -> Replay:
    """Raise ChallengeFailed unless the recipe of an inspector meets the challenge.

    A valid replay counts if a part that must pass, and the parts before it, still get their
    verdicts; otherwise the whole challenge is replayed.
    """
    # Hash every file again, even if its times are unchanged.
    _known_sha256.cache_clear()
    replay = valid_replay(files, inspector.fingerprint, raise_if_cancelled)
    outcomes = replay_challenge(files, inspector, raise_if_cancelled)
    judged = _up_to_a_good_part(outcomes)
    if replay is None or any(outcome.is_regression for outcome in judged):
        replay = _keep_replay(files, inspector, (*judged, *outcomes))
    if replay.regressions:
        named = "; ".join(map(str, replay.regressions))
        raise ChallengeFailed(
            f"recipe {inspector.recipe.name} does not run: {len(replay.regressions)} of "
            f"{len(replay.parts)} parts of its challenge set get another verdict: {named}; "
            "correct the recipe or the expected verdicts, then run ps4rig station challenge"
        )
    return replay


def _up_to_a_good_part(outcomes: Iterator[PartOutcome]) -> list[PartOutcome]:
    """Take outcomes up to the first part that must pass."""
    judged = []
    for outcome in outcomes:
        judged.append(outcome)
        if outcome.expected == Decision.PASS:
            break
    return judged


def _verdict_on(path: Path, inspector: Inspector) -> tuple[Verdict, str | None]:
    """Judge a set as if it was captured now; return also the hash of its pixels."""
    pixels_sha256 = None
    try:
        captured = CapturedSet.load(path)
        pixels_sha256 = captured.metadata.pixels_sha256
        changes: dict[str, object] = {"created_utc": utc_text(), "calibration_ids": ()}
        captured = replace(captured, metadata=captured.metadata.model_copy(update=changes))
        if inspector.calibration is not None:
            captured = captured.with_calibration(inspector.calibration.file)
        return inspector.inspect(captured).verdict, pixels_sha256
    except Exception as error:  # as in the cycle of the station: no exception may end in PASS
        return fault_of(error).verdict, pixels_sha256


def valid_replay(
    files: RecipeFolder,
    fingerprint: Fingerprint,
    raise_if_cancelled: Callable[[], None] = lambda: None,
) -> Replay | None:
    """Return the recorded replay if it has this challenge set and fingerprint."""
    replay = last_replay(files)
    if replay is None or replay.fingerprint != fingerprint:
        return None
    expected = {part.file: part.expected for part in replay.parts}
    if expected != dict(read_challenge(files.challenge).sets):
        return None
    for part in replay.parts:
        raise_if_cancelled()
        if part.file_sha256 is None or part.file_sha256 != _sha256(files.challenge / part.file):
            return None
    return replay


def _sha256(path: Path) -> str | None:
    """SHA-256 of a file, from the cache if its status is unchanged; None if it is unreadable."""
    try:
        status = path.stat()
        return _known_sha256(
            path, status.st_ino, status.st_size, status.st_mtime_ns, status.st_ctime_ns
        )
    except (InputError, OSError):
        return None


# Without a cache, a page with the state of a recipe would read 10 MB for each set of 1024 px.
@lru_cache(MAX_SETS)
def _known_sha256(path: Path, *stat: int) -> str:  # noqa: ARG001 - part of the key of the cache
    return file_sha256(path)


def last_replay(files: RecipeFolder) -> Replay | None:
    """Return the last recorded replay, of any state; None if there is none or it is damaged."""
    try:
        return Replay.read(files.replay, _MAX_BYTES, "replay it")
    except InputError:
        return None
