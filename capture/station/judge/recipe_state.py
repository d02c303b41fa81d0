"""`RecipeState`: why a recipe cannot run; library and models are not loaded for it."""

from dataclasses import dataclass

from capture.base.utc_time import local_time
from capture.calibration.lookup import FoundCalibration
from capture.station.domain.recipe import Recipe
from capture.station.domain.recipe_file import RecipeFolder, read_recipe
from capture.station.domain.taught import taught_for
from classify.base.errors import InputError

from .challenge import Replay, last_replay, valid_replay
from .challenge_set import read_challenge
from .fingerprint import Fingerprint


@dataclass(frozen=True)
class RecipeState:
    """A recipe, with the state of its approval and challenge."""

    recipe: Recipe
    problem: str | None  # why it cannot judge anything; None if it can
    challenge: str  # state of the challenge set, in words
    has_met_challenge: bool  # with exactly this recipe, calibration and software
    replay: Replay | None  # of this state or an earlier one; None without one

    @property
    def approval(self) -> str:
        """Who approved it, in words."""
        approval = self.recipe.approval
        if approval is None:
            return "not approved"
        if not self.recipe.is_approved:
            return f"changed since {approval.by} approved it"
        return f"approved by {approval.by}, {local_time(approval.utc)}"


def state_of(files: RecipeFolder, calibration: str | None) -> RecipeState:
    """Return the state of a recipe."""
    recipe, replay = read_recipe(files.file), last_replay(files)
    try:
        taught = taught_for(recipe, files)
        found_calibration = FoundCalibration.of_rig(calibration)
    except InputError as error:
        return RecipeState(recipe, str(error), "not replayed", False, replay)
    try:
        parts = len(read_challenge(files.challenge).sets)
        valid = valid_replay(files, Fingerprint.of(recipe, taught, found_calibration))
    except InputError as error:
        return RecipeState(recipe, None, str(error), False, replay)
    if valid is None:
        text = f"{parts} parts, not replayed since something changed"
    elif valid.regressions:
        text = f"{len(valid.regressions)} of {parts} parts got another verdict"
    else:
        text = f"all {parts} parts got the expected verdict, {local_time(valid.utc)}"
    has_met = valid is not None and not valid.regressions
    return RecipeState(recipe, None, text, has_met, replay)
