"""Every pixel format decodes as plain numpy does; decoding an encoded image gives the image."""

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rig import CameraError
from rig.cameras.v4l2.pixel_formats import PIXEL_FORMATS, PixelFormat, decode

UNCOMPRESSED = [entry for entry in PIXEL_FORMATS.values() if not entry.is_compressed]
WORDS = [entry for entry in UNCOMPRESSED if entry.bit_depth > 8]
MONO = [entry for entry in UNCOMPRESSED if entry.bytes_per_px == 1] + WORDS

sides = st.integers(1, 9)
seeds = st.integers(0, 2**32 - 1)
paddings = st.integers(0, 7)


def image_of(entry: PixelFormat, height: int, width: int, seed: int) -> npt.NDArray[np.uint16]:
    return np.random.default_rng(seed).integers(
        0, 1 << entry.bit_depth, (height, width), dtype=np.uint16
    )


def padded(rows: npt.NDArray[np.uint8], padding: int, *, whole: bool) -> bytes:
    """Rows padded with 0xFF; without `whole` the last row has no padding."""
    full = np.pad(rows, ((0, 0), (0, padding)), constant_values=255).tobytes()
    return full if whole or not padding else full[:-padding]


@settings(max_examples=25)  # for each format
@pytest.mark.parametrize("entry", MONO, ids=lambda entry: entry.name)
@given(height=sides, width=sides, seed=seeds, padding=paddings, whole=st.booleans())
def test_grey_and_bayer_values_are_unchanged(
    entry: PixelFormat, height: int, width: int, seed: int, padding: int, whole: bool
) -> None:
    image = image_of(entry, height, width, seed)
    stored = image.astype("<u2" if entry.bytes_per_px == 2 else np.uint8)
    rows = stored.view(np.uint8).reshape(height, -1)
    data = padded(rows, padding, whole=whole)
    pixels = decode(entry, data, width, height, rows.shape[1] + padding)
    assert pixels.dtype == (np.uint8 if entry.bit_depth == 8 else np.uint16)
    np.testing.assert_array_equal(pixels, image)


@pytest.mark.parametrize(("name", "position"), [("YUYV", 0), ("UYVY", 1)])
@given(height=sides, half=sides, seed=seeds, padding=paddings)
def test_luma_of_yuv_is_every_second_byte(
    name: str, position: int, height: int, half: int, seed: int, padding: int
) -> None:
    entry = PIXEL_FORMATS[name]
    luma = image_of(entry, height, 2 * half, seed)
    rows = np.full((height, 4 * half), 77, np.uint8)
    rows[:, position::2] = luma
    data = padded(rows, padding, whole=True)
    np.testing.assert_array_equal(decode(entry, data, 2 * half, height, 4 * half + padding), luma)


@pytest.mark.parametrize(("name", "weights"), [
    ("RGB24", (0.299, 0.587, 0.114)),
    ("BGR24", (0.114, 0.587, 0.299)),
])  # fmt: skip
@given(height=sides, width=sides, seed=seeds, padding=paddings)
def test_luma_of_colour_has_the_weights_of_bt601(
    name: str, weights: tuple[float, ...], height: int, width: int, seed: int, padding: int
) -> None:
    colours = np.random.default_rng(seed).integers(0, 256, (height, width, 3), dtype=np.uint8)
    data = padded(colours.reshape(height, -1), padding, whole=True)
    pixels = decode(PIXEL_FORMATS[name], data, width, height, 3 * width + padding)
    assert np.abs(pixels - colours @ np.array(weights)).max() <= 0.51


@settings(max_examples=25)  # for each format
@pytest.mark.parametrize("entry", UNCOMPRESSED, ids=lambda entry: entry.name)
@given(height=sides, half=sides, wrong=st.sampled_from([-1, 1]), padding=paddings)
def test_a_buffer_of_another_size_is_refused(
    entry: PixelFormat, height: int, half: int, wrong: int, padding: int
) -> None:
    row_bytes = 2 * half * entry.bytes_per_px
    stride = row_bytes + padding
    size = stride * height + 1 if wrong > 0 else stride * (height - 1) + row_bytes - 1
    with pytest.raises(CameraError, match=f"{entry.name} frame .* {size} bytes instead of"):
        decode(entry, bytes(size), 2 * half, height, stride)


def test_zero_bytes_per_line_mean_no_padding() -> None:
    pixels = decode(PIXEL_FORMATS["GREY"], bytes(range(6)), 3, 2, 0)
    np.testing.assert_array_equal(pixels, [[0, 1, 2], [3, 4, 5]])


def test_a_line_shorter_than_its_pixels_is_refused() -> None:
    with pytest.raises(CameraError, match=r"5 bytes per line, Y12 .* 6"):
        decode(PIXEL_FORMATS["Y12"], bytes(10), 3, 2, 5)


@pytest.mark.parametrize("name", [entry.name for entry in WORDS if entry.bit_depth < 16])
def test_a_value_beyond_the_true_depth_is_refused(name: str) -> None:
    entry = PIXEL_FORMATS[name]
    data = np.array([[0, 1 << entry.bit_depth]], "<u2").tobytes()
    with pytest.raises(CameraError, match=f"as {name}, which ends at"):
        decode(entry, data, 2, 1, 4)


def test_names_and_codes_are_unique() -> None:
    assert len({entry.fourcc for entry in PIXEL_FORMATS.values()}) == len(PIXEL_FORMATS) == 21
    assert all(len(entry.fourcc) == 4 for entry in PIXEL_FORMATS.values())


@pytest.mark.parametrize("name", ["GREY", "Y10", "Y12", "Y16"])
@given(height=st.integers(1, 9), width=st.integers(1, 9), seed=st.integers(0, 2**32 - 1))
def test_grey_is_restored_exactly(name: str, height: int, width: int, seed: int) -> None:
    entry = PIXEL_FORMATS[name]
    assert entry.to_bytes is not None
    image = np.random.default_rng(seed).integers(0, 2**entry.bit_depth, (height, width))
    pixels = image.astype(np.uint8 if entry.bit_depth == 8 else np.uint16)
    packed = entry.to_bytes(pixels)
    back = decode(entry, packed, width, height, width * entry.bytes_per_px)
    np.testing.assert_array_equal(back, pixels)


@pytest.mark.parametrize("name", ["YUYV", "UYVY"])
def test_luma_goes_from_16_to_235_and_has_no_colour(name: str) -> None:
    pixels = np.arange(256, dtype=np.uint8).reshape(16, 16)
    entry = PIXEL_FORMATS[name]
    assert entry.to_bytes is not None
    packed = entry.to_bytes(pixels)
    luma = decode(entry, packed, 16, 16, 32)
    np.testing.assert_allclose(luma, 16 + pixels * (219 / 255), atol=0.5)
    assert (luma.min(), luma.max()) == (16, 235)
    chroma = np.frombuffer(packed, np.uint8)[1 if name == "YUYV" else 0 :: 2]
    assert set(chroma.tolist()) == {128}
