"""Lights at positions, and images divided by a flat field."""

import numpy as np
import pytest

from classify import InputError, Lighting, photometric_stereo
from classify.lights.flat_field import FlatField


def test_images_divided_by_the_sheet_give_its_slope_and_levels() -> None:
    slants, levels = [40.0, 50.0, 45.0, 45.0], np.array([1.0, 0.8, 1.1, 0.95])
    lighting = Lighting.from_angles([0.0, 90.0, 180.0, 270.0], slants)
    coefficients = np.zeros((4, 3, 3))
    coefficients[:, 0, 0] = np.log(levels * lighting.directions[:, 2])
    coefficients[0, 0, 1], coefficients[1, 1, 0], coefficients[2, 1, 1] = 0.1, 0.2, -0.1
    coefficients[3, 0, 2], coefficients[3, 1, 0] = -0.2, 1.0
    flat_field = FlatField(coefficients, np.tile([-9.0, 9.0], (4, 1)))
    sheet = flat_field.strengths(np.arange(30), np.arange(40), (30, 40))
    flat = photometric_stereo(sheet.astype(np.float32), lighting, flat_field=flat_field)
    assert np.abs(flat.p).max() < 1e-5
    assert np.abs(flat.q).max() < 1e-5
    assert np.ptp(flat.albedo) < 1e-5
    tilted = sheet * (lighting.directions @ [-0.3, 0.1, 1.0])[:, None, None]
    tilted /= lighting.directions[:, 2, None, None]
    surface = photometric_stereo(tilted.astype(np.float32), lighting, "ps4", flat_field=flat_field)
    np.testing.assert_allclose(surface.p, 0.3, atol=1e-5)
    np.testing.assert_allclose(surface.q, -0.1, atol=1e-5)
    assert surface.residual.max() < 1e-5
    assert surface.led_levels is None


def test_the_flat_field_of_other_lights_is_an_error() -> None:
    flat_field = FlatField(np.zeros((3, 1, 1)), np.zeros((3, 2)))
    images = np.ones((4, 2, 2), np.float32)
    with pytest.raises(InputError, match="flat field is of 3 lights"):
        photometric_stereo(images, Lighting.ring(45.0), flat_field=flat_field)
