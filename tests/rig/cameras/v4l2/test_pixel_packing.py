"""Decoding a packed image gives the image."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rig.cameras.v4l2.pixel_formats import PIXEL_FORMATS, decode
from rig.cameras.v4l2.pixel_packing import PACKINGS


@pytest.mark.parametrize("name", ["GREY", "Y10", "Y12", "Y16"])
@given(height=st.integers(1, 9), width=st.integers(1, 9), seed=st.integers(0, 2**32 - 1))
def test_grey_is_restored_exactly(name: str, height: int, width: int, seed: int) -> None:
    entry, packing = PIXEL_FORMATS[name], PACKINGS[name]
    image = np.random.default_rng(seed).integers(0, 2**entry.bit_depth, (height, width))
    pixels = image.astype(np.uint8 if entry.bit_depth == 8 else np.uint16)
    packed = packing.to_bytes(pixels)
    assert (packing.fourcc, packing.bytes_per_px) == (entry.fourcc, entry.bytes_per_px)
    back = decode(entry, packed, width, height, width * packing.bytes_per_px)
    np.testing.assert_array_equal(back, pixels)


@pytest.mark.parametrize("name", ["YUYV", "UYVY"])
def test_luma_goes_from_16_to_235_and_has_no_colour(name: str) -> None:
    pixels = np.arange(256, dtype=np.uint8).reshape(16, 16)
    packed = PACKINGS[name].to_bytes(pixels)
    luma = decode(PIXEL_FORMATS[name], packed, 16, 16, 32)
    np.testing.assert_allclose(luma, 16 + pixels * (219 / 255), atol=0.5)
    assert (luma.min(), luma.max()) == (16, 235)
    chroma = np.frombuffer(packed, np.uint8)[1 if name == "YUYV" else 0 :: 2]
    assert set(chroma.tolist()) == {128}
