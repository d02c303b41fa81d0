"""The error of the tilts of all lights, from the slopes that they give."""

import numpy as np
import pytest

from classify import Lighting, photometric_stereo
from classify.surface.tilt_error import tilt_error_deg


@pytest.mark.parametrize("error_deg", [-8.0, 0.0, 4.0])
@pytest.mark.parametrize("kind", ["grain", "even"])
def test_the_error_of_the_tilts_is_found(
    texture, photographed, error_deg: float, kind: str
) -> None:
    images = photographed(texture(kind, 30.0, side=256)).images
    given = Lighting.ring(45.0, tuple(tilt + error_deg for tilt in (0, 90, 180, 270)))
    assert tilt_error_deg(photometric_stereo(images, given)) == pytest.approx(error_deg, abs=0.6)


def test_a_plane_has_none(surface_of) -> None:
    level = np.zeros((32, 32), np.float32)
    assert tilt_error_deg(surface_of(level, level, level + 0.5)) == 0.0
