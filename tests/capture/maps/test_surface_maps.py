"""Maps and roughness of a simulated capture against those of the true gradients."""

from dataclasses import replace

import numpy as np
import pytest

from capture.maps.map_kinds import MAP_KINDS
from capture.maps.surface_maps import SurfaceMaps
from classify import Lighting
from rig.scene.render import render_frame
from rig.scene.synthetic import synthetic_surface
from rig.simulation.sensor import SensorModel
from rig.simulation.simulated_set import SimulatedSet


@pytest.mark.parametrize("texture", ["rock", "sand"])
def test_maps_and_roughness_agree_with_the_true_surface(texture: str) -> None:
    lighting = Lighting.ring(45.0)
    scene = render_frame(synthetic_surface(texture, 0, 512), lighting, 192)
    surface = SimulatedSet.expose(scene, lighting, SensorModel(), seed=0).solve()
    everywhere = np.ones(surface.shape, bool)
    p, q = scene.p.astype(np.float32), scene.q.astype(np.float32)
    found = SurfaceMaps(surface)
    true = SurfaceMaps(replace(surface, p=p, q=q, valid=everywhere))
    for name in ("height", "raised", "mean_curvature", "gaussian_curvature"):
        pair = [maps.values(MAP_KINDS[name])[surface.valid] for maps in (found, true)]
        assert np.corrcoef(*pair)[0, 1] > 0.97, name
        assert pair[0].std() == pytest.approx(pair[1].std(), rel=0.05), name
    for name in ("sdq", "sdr_percent", "sa_px", "sq_px"):
        value, expected = (getattr(maps.roughness, name) for maps in (found, true))
        assert value == pytest.approx(expected, rel=0.03), name
