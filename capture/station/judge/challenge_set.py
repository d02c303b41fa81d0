"""The challenge set of a recipe: captured sets with the verdict that each must get."""

import json
import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Literal, get_args

from pydantic import Field

from capture.base.folder_lock import folder_lock
from capture.base.names import Name
from capture.sets.captured_set import LoadedSet
from capture.station.domain.errors import NotFound, RecipeError
from capture.station.domain.verdict import Decision
from classify.base.durable_file import durable_file, make_folder
from classify.base.models import Section, read_toml_as, validated

FILE = "challenge.toml"
_LOCK = "challenge.lock"
# ``reject`` is anything but PASS.
Expected = Literal["reject", "PASS", "FAIL", "UNKNOWN"]
EXPECTED: tuple[Expected, ...] = get_args(Expected)
_RecordChange = Callable[[str, Expected | None, Expected | None], None]
"""Called with a file and its old and new verdict, before anything is written."""
MAX_SETS = 10_000

_HEAD = """\
# Captured sets in this folder, and the verdict that each must get before a changed recipe runs;
# "reject" is anything but PASS.
# ps4rig station challenge DIR --add SET --expect PASS|reject|FAIL|UNKNOWN adds one.

[sets]
"""


class _ChallengeSet(Section):
    """The files of a challenge and the verdict that each must get."""

    sets: Annotated[Mapping[Name, Expected], Field(max_length=MAX_SETS)]


def read_challenge(folder: Path) -> _ChallengeSet:
    """Read a challenge set; raise `RecipeError` unless it has parts of both kinds."""
    if_missing = (
        "there is no challenge set; add parts with ps4rig station challenge DIR --add SET "
        "--expect PASS or reject"
    )
    challenge = read_toml_as(folder / FILE, _ChallengeSet, if_missing)
    passing = sum(expected == Decision.PASS for expected in challenge.sets.values())
    if not 0 < passing < len(challenge.sets):
        raise RecipeError(
            f"{folder / FILE}: {passing} parts that must pass and "
            f"{len(challenge.sets) - passing} that must not: add one of each, because a station "
            "that passes or rejects everything would meet the challenge"
        )
    return challenge


def challenge_sets(folder: Path) -> dict[str, Expected]:
    """Return files and verdicts of a challenge; empty if there is no challenge set."""
    if not (folder / FILE).exists():
        return {}
    return dict(read_toml_as(folder / FILE, _ChallengeSet, "").sets)


def add_to_challenge(
    folder: Path,
    paths: Sequence[Path],
    expected: Expected,
    record: _RecordChange = lambda *_: None,
) -> None:
    """Copy sets into a challenge; those that are in it get the new expected verdict.

    `record` is called for each change before the first one is made. If it raises, nothing changes.
    """
    make_folder(folder)
    with folder_lock(folder, _LOCK):
        before = challenge_sets(folder)
        sets = before | {path.name: expected for path in paths}
        checked = validated({"sets": sets}, _ChallengeSet, str(folder / FILE))
        sources: dict[str, Path] = {}
        for path in paths:
            if not _is_copied(path, sources.get(path.name, folder / path.name)):
                sources[path.name] = path
        for name in sets:
            if before.get(name) != sets[name]:
                record(name, before.get(name), sets[name])
        for name, path in sources.items():
            with durable_file(folder / name) as temporary:
                shutil.copyfile(path, temporary)
        _write(folder, checked)


def _is_copied(path: Path, copy: Path) -> bool:
    """Whether `copy` exists and holds the same set; raise `RecipeError` if it holds another."""
    pixels_sha256 = LoadedSet.of(path).captured.metadata.pixels_sha256
    if not copy.exists():
        return False
    if LoadedSet.of(copy).captured.metadata.pixels_sha256 != pixels_sha256:
        raise RecipeError(f"{copy}: is another set; rename {path} to add it")
    return True


def remove_from_challenge(folder: Path, file: str, record: _RecordChange = lambda *_: None) -> None:
    """Take a set out of a challenge; its file stays. `record` as for `add_to_challenge`."""
    not_listed = NotFound(f"{file[:100]!r} is not in the challenge set")
    if not folder.is_dir():  # without it there is no lock file
        raise not_listed
    with folder_lock(folder, _LOCK):
        sets = challenge_sets(folder)
        before = sets.pop(file, None)
        if before is None:
            raise not_listed
        record(file, before, None)
        _write(folder, _ChallengeSet(sets=sets))


def _write(folder: Path, challenge: _ChallengeSet) -> None:
    lines = "".join(
        f'{json.dumps(name)} = "{expected}"\n' for name, expected in challenge.sets.items()
    )
    with durable_file(folder / FILE) as temporary:
        temporary.write_text(_HEAD + lines, encoding="utf-8")
