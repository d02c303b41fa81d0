"""Who asks a running station for another recipe, and why it is refused."""

from enum import Enum, auto
from typing import NamedTuple

from classify.base.errors import Ps4rigError


class Asker(NamedTuple):
    """Who asks for a recipe: a name, and a role such as ``engineer``."""

    name: str
    role: str
    seen_sha256: str | None = None  # hash of the recipe that the asker saw; None if none was shown


class RecipeRefusal(Enum):
    """Kinds of reasons why a recipe is not loaded, for programs."""

    NOT_READY = auto()  # the station starts, stops, is in error, or judges no parts
    BUSY = auto()  # another one is being loaded
    UNKNOWN = auto()
    NOT_APPROVED = auto()
    CHALLENGE = auto()
    UNUSABLE = auto()  # not taught, damaged, not the one seen, without challenge set or calibration
    RIG = auto()  # the self-test with its light found a fault
    DATABASE = auto()  # the change cannot be recorded
    UNFORESEEN = auto()


class RecipeRefused(Ps4rigError):  # noqa: N818 - an answer, no error of the program
    """A recipe is not loaded; the station goes on with the present one."""

    def __init__(self, reason: str, kind: RecipeRefusal) -> None:
        super().__init__(reason)
        self.kind = kind
