"""`Calibration`: corrected images, and their lights and noise."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from classify import InputError, Lighting, SensorNoise
from classify.calibration.calibration import CalibratedLights, Calibration, Response, Scale
from classify.calibration.dark import Dark
from classify.images import ImageStack

FULL = 4095.0
GAMMA = Response(np.linspace(0.0, 1.0, 257) ** 2.2, 0.0, linear=False)
NO_HOT = np.empty((0, 2), np.int32)


def dark(offset: float = 0.0, hot: np.ndarray = NO_HOT, full_scale: float = FULL) -> Dark:
    return Dark(offset, 1.0, np.asarray(hot, np.int32), None, full_scale)


def smooth(shape: tuple[int, int] = (24, 30), lights: int = 4) -> np.ndarray:
    """Light images without detail, (lights, rows, columns) as shares of full scale."""
    y, x = np.mgrid[: shape[0], : shape[1]] / max(shape)
    return np.stack([0.2 + 0.5 * (x * (k + 1) / lights + 0.4 * y) for k in range(lights)])


def stack_of(images: np.ndarray, ambient: np.ndarray | None = None) -> ImageStack:
    return ImageStack(np.ascontiguousarray(images), ambient)


def lens(k1: float, shape: tuple[int, int]) -> Scale:
    rows, columns = shape
    matrix = np.array([[60.0, 0, (columns - 1) / 2], [0, 60.0, (rows - 1) / 2], [0, 0, 1]])
    return Scale(0.1, 0.001, matrix, np.array([k1, 0.0, 0.0, 0.0, 0.0]), 0.1)


def test_without_anything_to_correct_the_same_images_are_returned() -> None:
    stack = stack_of((FULL * smooth()).astype(np.uint16))
    straight = Response(np.linspace(0.0, 1.0, 257), 0.0, linear=True)
    scale = Scale(0.1, 0.001, np.eye(3), None, 0.1)
    for calibration in (Calibration(), Calibration(dark(), straight, scale=scale)):
        assert calibration.corrected(stack, FULL) is stack
    mask = np.ones((24, 30), np.bool_)
    assert Calibration(scale=scale).corrected_mask(mask) is mask


@given(
    hot=st.lists(st.tuples(st.integers(0, 23), st.integers(0, 29)), max_size=20, unique=True),
    dtype=st.sampled_from([np.uint8, np.uint16, np.float32]),
)
def test_hot_pixels_become_their_neighbours(hot: list[tuple[int, int]], dtype: type) -> None:
    full = 255.0 if dtype is np.uint8 else FULL
    clean = (full * smooth()).astype(dtype)
    spoilt = clean.copy()
    for row, column in hot:
        spoilt[:, row, column] = full
    places = np.array(hot, np.int32).reshape(-1, 2)
    calibration = Calibration(dark(hot=places, full_scale=full))
    corrected = calibration.corrected(stack_of(spoilt, spoilt[0]), full)
    assert corrected.images.dtype == dtype
    step = 0.06 * full  # two pixels of the steepest image
    assert np.abs(corrected.images.astype(float) - clean).max() <= step
    np.testing.assert_array_equal(corrected.ambient, corrected.images[0])


def test_a_hot_pixel_among_hot_ones_stays_and_one_outside_is_refused() -> None:
    block = np.argwhere(np.ones((3, 3), bool)) + 5
    images = np.full((4, 24, 30), 100, np.uint16)
    images[:, 5:8, 5:8] = 4000
    calibration = Calibration(dark(hot=block))
    corrected = calibration.corrected(stack_of(images), FULL).images
    assert (corrected[:, 6, 6] == 4000).all()
    assert np.count_nonzero(corrected != 100) == 4
    with pytest.raises(InputError, match=r"row 24, column 0, .* 30 x 24 px"):
        Calibration(dark(hot=[[24, 0]])).corrected(stack_of(images), FULL)


@given(full=st.sampled_from([255.0, FULL, 65535.0]))
def test_a_curved_response_is_undone_and_saturation_stays(full: float) -> None:
    dtype = np.uint8 if full == 255.0 else np.uint16
    light = smooth()
    light[:, 0, :3] = 1.0
    raw = np.rint(full * light ** (1.0 / 2.2)).astype(dtype)
    corrected = Calibration(response=GAMMA).corrected(stack_of(raw, raw[0]), full)
    assert corrected.images.dtype == np.float32
    np.testing.assert_allclose(corrected.images / full, light, atol=2.2 / full + 1e-4)
    assert ((corrected.images >= full) == (raw >= full)).all()
    np.testing.assert_array_equal(corrected.ambient, corrected.images[0])


@pytest.mark.parametrize("response", [None, GAMMA])
def test_the_offset_is_subtracted_only_without_an_ambient_image(response: Response | None) -> None:
    raw = (FULL * smooth()).astype(np.uint16)
    raw[:, 0, 0] = int(FULL)
    # A calibration at 8 bit of a camera whose images are stretched to 12.
    calibration = Calibration(dark(16.0, full_scale=255.0), response)
    with_ambient = calibration.corrected(stack_of(raw, raw[0]), FULL)
    linear = Calibration(response=response).corrected(stack_of(raw, raw[0]), FULL)
    np.testing.assert_array_equal(with_ambient.images, linear.images)
    without = calibration.corrected(stack_of(raw), FULL).images
    share = 16.0 / 255.0
    offset = FULL * (share if response is None else np.interp(256 * share, range(257), GAMMA.curve))
    np.testing.assert_allclose(linear.images[:, 1:] - without[:, 1:], offset, rtol=1e-3)
    assert (without[:, 0, 0] == FULL).all()


@pytest.mark.parametrize("dtype", [np.uint16, np.float32])
def test_distortion_is_removed_with_the_mask_and_saturation(dtype: type) -> None:
    shape = (64, 80)
    scale = lens(-0.1, shape)
    y, x = np.mgrid[:64, :80].astype(np.float32)
    straight = (1000 + 20 * x + 10 * y).astype(np.float32)
    # The distorted image: each of its pixels comes from an undistorted place.
    grid = np.stack([x, y], axis=-1).reshape(-1, 1, 2)
    places = cv2.undistortPoints(grid, scale.camera_matrix, scale.distortion, P=scale.camera_matrix)
    at = places.reshape(64, 80, 2)
    distorted = np.clip(1000 + 20 * at[..., 0] + 10 * at[..., 1], 0, 4000).astype(dtype)
    moved = np.hypot(at[..., 0] - x, at[..., 1] - y)
    assert moved.max() > 1.5
    distorted[30:34, 40:44] = FULL
    corrected = Calibration(scale=scale).corrected(stack_of(distorted[None]), FULL).images[0]
    inner = np.zeros(shape, bool)
    inner[8:-8, 8:-8] = True
    saturated = corrected >= FULL
    assert saturated.any()
    assert corrected[inner & ~saturated].max() <= 4000
    errors = np.abs(corrected.astype(float) - straight)[inner & ~saturated]
    assert errors.max() <= 1.0  # a twentieth of a pixel
    mask = Calibration(scale=scale).corrected_mask(distorted < FULL)
    assert (mask[inner] == ~saturated[inner]).mean() > 0.99


def test_measured_lights_keep_the_given_intensities() -> None:
    ring, measured = Lighting.ring(45.0), Lighting.ring(47.0)
    lights = CalibratedLights(measured, "plate", np.zeros(4), None, 0.0, None)
    calibration = Calibration(lights=lights)
    assert not calibration.lighting_of(ring).intensities_given
    given_levels = Lighting(ring.directions, np.array([1.0, 0.9, 1.1, 1.0]))
    used = calibration.lighting_of(given_levels)
    np.testing.assert_array_equal(used.intensities, given_levels.intensities)
    np.testing.assert_allclose(used.directions, measured.directions)
    assert Calibration().lighting_of(ring) is ring
    with pytest.raises(InputError, match=r"4 lights, .* 3"):
        calibration.lighting_of(Lighting.ring(45.0, (0, 120, 240)))


def test_the_noise_follows_the_corrections() -> None:
    sensor = SensorNoise(2.0, 3.0, 16.0)
    calibration = Calibration(dark(16.0))
    assert calibration.noise_of(sensor, has_ambient=True) is sensor
    corrected = calibration.noise_of(sensor, has_ambient=False)
    assert corrected == SensorNoise(2.0, 3.0, 0.0)
    assert Calibration(response=GAMMA).noise_of(sensor, has_ambient=True) is None
    assert Calibration().noise_of(None, has_ambient=True) is None
