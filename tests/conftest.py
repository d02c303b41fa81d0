"""What all tests share: threads of the computing libraries, and scenes that are rendered once."""

import os
from collections import OrderedDict
from collections.abc import Iterator

import pytest
from hypothesis import settings

# Frames of tests are small: a second thread gains nothing, and the first then waits for it while
# other programs have the cores. The library reads this when it is loaded.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numba

from rig import Placement, Simulation
from rig.scene.render import SceneImages

_KEPT_SCENES = 64

# How long an example takes is a matter of what else the machine does.
settings.register_profile("any machine", deadline=None)
settings.load_profile("any machine")


@pytest.fixture(autouse=True)
def threads(request: pytest.FixtureRequest) -> None:
    """One thread for the kernels of small frames, all of them in the slow tests."""
    slow = request.node.get_closest_marker("slow") is not None
    numba.set_num_threads(numba.config.NUMBA_NUM_THREADS if slow else 1)


@pytest.fixture(scope="session", autouse=True)
def scenes_are_rendered_once() -> Iterator[None]:
    """Most rigs of tests stand above the same few parts, and to render one takes the longest."""
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
