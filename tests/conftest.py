"""What all tests share: the needs of suites, threads, and repeatable examples."""

import gc
import os
import signal
import sys
from collections.abc import Callable, Generator
from functools import partial

import hypothesis
import pytest
from _pytest.mark.expression import Expression
from _pytest.terminal import TerminalReporter

from .suites import NEEDS, missing

# ps4rig is imported by the fixture that uses it, because `pytest_configure` runs after the imports
# here and reports within a second what is missing.

# The same examples in every run, however long they take on a busy machine. To search for new ones:
# pytest --hypothesis-profile search
hypothesis.settings.register_profile("search", deadline=None)
hypothesis.settings.register_profile("repeatable", deadline=None, derandomize=True)
hypothesis.settings.load_profile("repeatable")

_FIGURES = "figures"

# Test frames are small: a second OpenBLAS thread gains nothing and waits for a busy core.
# OpenBLAS reads this when it is loaded.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# Hundreds of tests start the program, which would compile its modules anew in each process.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# Background jobs of a shell ignore these signals, and so would the processes that tests interrupt.
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGQUIT, signal.SIG_DFL)
signal.signal(signal.SIGHUP, signal.SIG_DFL)


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


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Import all tests without the garbage collector, which takes a sixth of the time."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()


@pytest.fixture
def show_figures(record_property: Callable[[str, object], None]) -> Callable[[str], None]:
    """Show what a test measured after the last test, also where pytest runs in two processes."""
    return partial(record_property, _FIGURES)


def pytest_terminal_summary(terminalreporter: TerminalReporter) -> None:
    """Show the figures of all tests."""
    for report in terminalreporter.getreports("passed") + terminalreporter.getreports("failed"):
        for name, text in report.user_properties:
            if name == _FIGURES:
                terminalreporter.write_line(f"\n{report.nodeid}\n{text}")


@pytest.fixture(autouse=True)
def threads(request: pytest.FixtureRequest) -> None:
    """Run kernels on one thread, or in a slow test on all, wherever the system chooses."""
    from classify.base.threads import bind_workers, set_thread_count

    slow = request.node.get_closest_marker("slow") is not None
    set_thread_count(None if slow else 1)
    bind_workers(is_bound=False)
