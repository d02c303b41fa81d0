"""The work of jobs, in their own process: teach parts, replay the challenge set."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from capture.base.console import ShowProgress
from capture.station.domain.recipe_folder import RecipeFolder
from capture.station.judge.challenge import run_challenge
from capture.station.judge.inspector import Inspector
from capture.station.judge.teaching.teaching import teach


def teach_parts(
    show: ShowProgress, files: RecipeFolder, paths: Sequence[Path], texture: str, is_good: bool
) -> dict[str, Any]:
    """Teach parts of a texture."""
    bad, good = (None, texture or None) if is_good else (texture, None)
    return teach(files, paths, bad, good_texture=good, show=show).fields()


def replay_parts(
    show: ShowProgress, files: RecipeFolder, calibration: Path | None
) -> dict[str, Any]:
    """Judge every part of the challenge set."""
    replay = run_challenge(files, Inspector.load(files, calibration), show)
    return {
        "parts": len(replay.parts),
        "regressions": [str(each) for each in replay.regressions],
        "recipe_sha256": replay.fingerprint.recipe_sha256,
    }
