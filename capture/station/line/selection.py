"""`Selection`: the handshake by which a PLC lets the station load a recipe, without I/O."""

from dataclasses import dataclass

from capture.station.run.events import RecipeLoaded
from capture.station.run.triggers import Asker, RecipeRefusal

from .registers import SelectError

SOURCE = "modbus"
ASKER = Asker("PLC", SOURCE)


@dataclass(frozen=True, eq=False)
class RecipeRequest:
    """A recipe that the PLC wants to be loaded."""

    name: str


class Selection:
    """The state of the last rise of SelectRecipe.

    A selection that is withdrawn goes on: until its recipe is loaded no other one can be selected.
    """

    def __init__(self) -> None:
        self.position = 0
        self.loading: RecipeRequest | None = None  # until the station has answered
        # The answer; it is taken back when SelectRecipe falls.
        self.is_loaded = False
        self.error = SelectError.NONE
        self._current: RecipeRequest | None = None  # None after SelectRecipe fell

    def select(self, position: int, name: str | None) -> None:
        """Take a rise of SelectRecipe; `name` is that of the recipe, None if there is none."""
        self.withdraw()
        self.position = position
        if self.loading is not None:
            self.error = SelectError.BUSY
        elif name is None:
            self.error = SelectError.UNKNOWN
        else:
            self._current = self.loading = RecipeRequest(name)

    def withdraw(self) -> None:
        """Take a fall of SelectRecipe."""
        self._current, self.is_loaded, self.error = None, False, SelectError.NONE

    def refused(self, request: RecipeRequest, kind: RecipeRefusal) -> None:
        """Take the refusal of a request."""
        if self.loading is request:
            self.loading = None
        if self._current is request:
            self.error = SelectError[kind.name]

    def tell(self, event: RecipeLoaded) -> None:
        """Take a recipe that the station has loaded, for the PLC or for somebody else."""
        request = self.loading
        if request is not None and (event.by, event.name) == (ASKER.name, request.name):
            self.loading = None
            self.is_loaded = self._current is request
