"""`Changeover`: exchange the recipe of a running station between two parts."""

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import dataclass, field

from capture.station.domain.errors import error_text

from .events import RecipeLoaded, State, Warned
from .outcome import PartJudge
from .run_recipes import RunRecipes, UsableRecipe
from .self_test import SelfTest
from .station_rig import StationRig
from .station_state import StationState
from .triggers import Asker, RecipeRefusal, RecipeRefused

# Time that a second asker waits until the recipe of the first is loaded.
TIMEOUT_S = 1.0


@dataclass(frozen=True, eq=False)
class _RecipeRequest:
    """A recipe that waits for the parts in progress, and the answer to its asker."""

    recipe: UsableRecipe
    by: Asker
    answer: "Future[RecipeLoaded]" = field(default_factory=Future)


class Changeover:
    """Exchanges the recipe, while the asker waits in `loading`.

    All methods but `loading` and `exchange` are called under the lock of the station.
    """

    def __init__(
        self,
        recipes: RunRecipes | None,
        publish: Callable[[RecipeLoaded | Warned], None],
        is_stopping: Callable[[], bool],
    ) -> None:
        self._recipes, self._publish, self._is_stopping = recipes, publish, is_stopping
        self._loading_lock = threading.Lock()
        self._request: _RecipeRequest | None = None

    @property
    def is_requested(self) -> bool:
        """Whether a recipe waits for the end of the parts in progress."""
        return self._request is not None

    def lacks(self, name: str | None) -> bool:
        """Whether the loaded recipe is not the one that a trigger requires; None requires none."""
        recipes = self._recipes
        return name is not None and (recipes is None or recipes.present.recipe.name != name)

    @contextmanager
    def loading(self, name: str, by: Asker) -> Iterator[_RecipeRequest]:
        """Load a recipe while parts go on, and run the block with the request."""
        if self._recipes is None:
            raise RecipeRefused("the station judges no parts", RecipeRefusal.NOT_READY)
        if not self._loading_lock.acquire(timeout=TIMEOUT_S):
            raise RecipeRefused("another recipe is being loaded", RecipeRefusal.BUSY)
        try:
            request = _RecipeRequest(self._recipes.load(name, by, self._raise_if_cancelled), by)
            self._raise_if_cancelled()
            yield request
        except RecipeRefused as error:
            self._publish(Warned(f"recipe {name} is not loaded for {by.name}: {error}"))
            raise
        finally:
            self._loading_lock.release()

    def _raise_if_cancelled(self) -> None:
        if self._is_stopping():
            raise RecipeRefused("the station stops", RecipeRefusal.NOT_READY)

    def request_exchange(self, request: _RecipeRequest, station: StationState) -> None:
        """Request a recipe for the time when no part is in progress, or raise RecipeRefused."""
        if station.state not in (State.READY, State.EXECUTING):
            raise RecipeRefused(f"not ready: {station.reason}", RecipeRefusal.NOT_READY)
        self._raise_if_cancelled()
        self._request = request

    def refuse(self, reason: str) -> None:
        """Refuse the recipe that waits, if there is one."""
        request, self._request = self._request, None
        if request is not None:
            request.answer.set_exception(RecipeRefused(reason, RecipeRefusal.NOT_READY))

    def pop_request(self) -> _RecipeRequest | None:
        """Return the waiting recipe for `exchange`, or None; `refuse` no longer affects it."""
        request, self._request = self._request, None
        return request

    def exchange(self, request: _RecipeRequest, rig: StationRig, self_test: SelfTest) -> PartJudge:
        """Exchange the recipe between parts, and return the new judge.

        After an exception the present recipe stays, and the rig is closed.
        """
        recipes, recipe = self._recipes, request.recipe
        assert recipes is not None
        try:
            with self_test.collecting() as require:
                rig.use(recipe.inspector)
                require(recipe.checks())
                require(rig.test(is_start=False))
            # Recorded before the announcement: a kill in between leaves a usable recipe.
            recipes.keep(recipe, request.by)
        except BaseException as error:
            try:
                rig.close()
                rig.use(recipes.present.inspector)
            finally:  # The asker waits without a time-out.
                refused = RecipeRefused(error_text(error), RecipeRefusal.RIG)
                request.answer.set_exception(error if isinstance(error, RecipeRefused) else refused)
            raise
        self._publish(recipe.loaded_event)
        return recipe.judge
