"""Maps and roughness of a simulated capture against those of the true gradients."""

from dataclasses import replace

import numpy as np
import pytest

from capture.maps.surface_maps import SurfaceMaps
from classify import Lighting
from rig.scene.render import render_frame
from rig.scene.synthetic import synthetic_surface
from rig.simulation.sensor import SensorModel
from rig.simulation.simulated_set import SimulatedSet


@pytest.fixture(scope="module", params=["rock", "sand"])
def found_and_true(request: pytest.FixtureRequest) -> tuple[SurfaceMaps, SurfaceMaps]:
    lighting = Lighting.ring(45.0)
    scene = render_frame(synthetic_surface(request.param, 0, 512), lighting, 192)
    found = SimulatedSet.expose(scene, lighting, SensorModel(), seed=0).solve()
    everywhere = np.ones(found.shape, bool)
    p, q = scene.p.astype(np.float32), scene.q.astype(np.float32)
    return SurfaceMaps.of(found), SurfaceMaps.of(replace(found, p=p, q=q, valid=everywhere))


def test_maps_agree_with_the_true_surface(
    found_and_true: tuple[SurfaceMaps, SurfaceMaps],
) -> None:
    found, true = found_and_true
    for name in ("height", "raised", "mean_curvature", "gaussian_curvature"):
        pair = [getattr(maps, name).ravel() for maps in (found, true)]
        assert np.corrcoef(*pair)[0, 1] > 0.97, name
        assert pair[0].std() == pytest.approx(pair[1].std(), rel=0.05), name


def test_roughness_agrees_with_the_true_surface(
    found_and_true: tuple[SurfaceMaps, SurfaceMaps],
) -> None:
    found, true = (maps.roughness for maps in found_and_true)
    assert found is not None
    assert true is not None
    for name in ("sdq", "sdr_percent", "sa_px", "sq_px"):
        assert getattr(found, name) == pytest.approx(getattr(true, name), rel=0.03), name
