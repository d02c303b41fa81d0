"""Lights from pictures of mirror and matt spheres."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from classify.calibration.spheres import SpherePictures, lights_from_spheres
from tests.sphere_pictures import Picture, scattered_lights

FRAME = (240, 320)


def off_deg(found: np.ndarray, true: np.ndarray) -> np.ndarray:
    true = true / np.linalg.norm(true, axis=1, keepdims=True)
    return np.degrees(np.arccos(np.clip((found * true).sum(axis=1), -1.0, 1.0)))


def taken(picture: Picture, kind: str, *, masked: bool = True) -> SpherePictures:
    images, mask = picture.images(kind)
    return SpherePictures(images, 255.0, None, mask if masked else None)


PLACES = st.tuples(st.floats(-40, 40), st.floats(-20, 20), st.floats(40, 70))


@settings(max_examples=6, deadline=None)
@given(
    PLACES,
    st.integers(0, 10**6),
    st.sampled_from(["black", "cloth", "clutter", "sheet"]),
    st.sampled_from([None, 900.0]),
    st.sampled_from([None, 70]),
)
def test_a_mirror_sphere_gives_distant_lights_within_its_error(
    place: tuple[float, float, float],
    seed: int,
    background: str,
    focal: float | None,
    jpeg: int | None,
) -> None:
    x, y, radius = place
    lights = scattered_lights(5, seed)
    picture = Picture(
        lights, centre=(x, y), radius=radius, seed=seed, background=background, focal=focal,
        jpeg=jpeg,
    )  # fmt: skip
    found = lights_from_spheres([taken(picture, "mirror")], "mirror", focal_px=focal)
    off = off_deg(found.lights.lighting.directions, lights)
    assert np.median(off) < 0.5
    assert (off < 4.0 * found.lights.direction_errors_deg).all()
