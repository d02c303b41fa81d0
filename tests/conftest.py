"""What all tests share: suites and their needs, and threads."""

import os
import signal

import pytest
from _pytest.mark.expression import Expression

from .suites import NEEDS, missing

# The rig and its libraries are imported by the fixtures that use them, because
# `pytest_configure` comes after the imports and reports what is missing within a second.

# Test frames are small: a second OpenBLAS thread gains nothing and waits for a busy core.
# OpenBLAS reads this when it is loaded.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# A shell's background jobs ignore SIGINT, and so would the processes that tests interrupt.
signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_configure(config: pytest.Config) -> None:
    """Refuse to run a suite that lacks what it needs, before anything else is run."""
    asked = config.option.markexpr
    for suite in NEEDS:
        selected = not asked or Expression.compile(asked).evaluate(
            lambda name, suite=suite, **_: name == suite
        )
        if selected and (lacks := missing(suite)):
            raise pytest.UsageError(
                f"the {suite} suite lacks {', '.join(lacks)}: run tests/install.sh {suite}"
            )


@pytest.fixture(autouse=True)
def threads(request: pytest.FixtureRequest) -> None:
    """Run kernels on one thread, or in a slow test on all."""
    from classify.threads import set_thread_count

    slow = request.node.get_closest_marker("slow") is not None
    set_thread_count(None if slow else 1)
