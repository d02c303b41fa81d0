"""`SharedAnswers`: one answer for several clients that ask for it at the same time."""

import asyncio
from collections.abc import Callable, Coroutine, Hashable
from typing import Any


class SharedAnswers:
    """Answers in the making. All pages show the last part, and ask for its pictures at once."""

    def __init__(self) -> None:
        self._made: dict[Hashable, asyncio.Task[bytes]] = {}

    async def answer(self, key: Hashable, make: Callable[[], Coroutine[Any, Any, bytes]]) -> bytes:
        """Return what `make` returns, or raise what it raises, for all who ask meanwhile.

        It goes on if a client leaves: others may wait for it.
        """
        task = self._made.get(key)
        if task is None:
            task = self._made[key] = asyncio.create_task(make())
            task.add_done_callback(lambda done: self._forget(key, done))
        return await asyncio.shield(task)

    def _forget(self, key: Hashable, done: asyncio.Task[bytes]) -> None:
        del self._made[key]
        if not done.cancelled():
            done.exception()  # retrieved here, because all clients may have left
