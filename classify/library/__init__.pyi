from .candidates import Sieve
from .evaluation import Evaluation, Trial, evaluate
from .match import Match
from .ps4lib import check_path
from .texture_library import TextureLibrary, TrainingRow, common_lighting, observe

__all__ = [
    "Evaluation",
    "Match",
    "Sieve",
    "TextureLibrary",
    "TrainingRow",
    "Trial",
    "check_path",
    "common_lighting",
    "evaluate",
    "observe",
]
