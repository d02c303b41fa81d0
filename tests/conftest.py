"""What all tests share: suites and their needs, threads, and scenes that are rendered once."""

import os
import signal
from collections import OrderedDict
from collections.abc import Iterator

import pytest
from _pytest.mark.expression import Expression

from .suites import NEEDS, missing

# The rig and its libraries are imported by the fixtures that use them, because
# `pytest_configure` comes after the imports and reports what is missing within a second.

_KEPT_SCENES = 64

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
    """Run numba kernels on one thread, or in a slow test on all."""
    import numba

    slow = request.node.get_closest_marker("slow") is not None
    numba.set_num_threads(numba.config.NUMBA_NUM_THREADS if slow else 1)


@pytest.fixture(scope="session", autouse=True)
def scenes_are_rendered_once() -> Iterator[None]:
    """Most rigs of tests stand above the same few parts, and to render one takes the longest."""
    from rig import Placement, Simulation
    from rig.scene.render import SceneImages

    render = Simulation._rendered
    scenes: OrderedDict[object, SceneImages] = OrderedDict()

    def rendered_once(simulation: Simulation, placement: Placement) -> SceneImages:
        config = simulation._config
        frame = config.camera.width_px, config.camera.height_px
        key = (placement, config.lights, frame, config.simulation.ambient)
        if key not in scenes:
            scenes[key] = render(simulation, placement)
            if len(scenes) > _KEPT_SCENES:
                scenes.popitem(last=False)
        return scenes[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Simulation, "_rendered", rendered_once)
        yield
