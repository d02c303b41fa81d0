"""Every packing gives back the pixels that were packed, bit by bit."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rig import CameraError
from rig.cameras.genicam.pixel_formats import PIXEL_FORMATS, decode, packed_12p

WIDTH, HEIGHT = 8, 3


def packed(name: str, pixels: list[int]) -> bytes:
    """Write the bits of each pixel as PFNC 2.1 and GigE Vision 1.2 define them."""
    depth = PIXEL_FORMATS[name].bit_depth
    if name.endswith("p"):
        bits = sum(pixel << (number * depth) for number, pixel in enumerate(pixels))
        return bits.to_bytes(len(pixels) * depth // 8, "little")
    if name.endswith("Packed"):
        low = depth - 8
        mask = (1 << low) - 1
        pairs = zip(pixels[::2], pixels[1::2], strict=True)
        return bytes(
            part for a, b in pairs for part in (a >> low, (a & mask) | (b & mask) << 4, b >> low)
        )
    return b"".join(pixel.to_bytes(1 if depth == 8 else 2, "little") for pixel in pixels)


@pytest.mark.parametrize("name", [name for name in PIXEL_FORMATS if name.startswith("Mono")])
@given(data=st.data())
def test_pixels_come_back_from_their_packing(name: str, data: st.DataObject) -> None:
    depth = PIXEL_FORMATS[name].bit_depth
    count = WIDTH * HEIGHT
    pixels = data.draw(st.lists(st.integers(0, 2**depth - 1), min_size=count, max_size=count))
    if name == "Mono12p":
        assert packed_12p(np.array(pixels, np.uint16)) == packed(name, pixels)
    image = decode(name, packed(name, pixels), WIDTH, HEIGHT)
    assert image.shape == (HEIGHT, WIDTH)
    assert image.dtype == (np.uint8 if depth == 8 else np.uint16)
    assert image.ravel().tolist() == pixels


@pytest.mark.parametrize("name", ["Mono8", "Mono12p", "BayerRG16"])
def test_a_buffer_of_another_length_is_an_error(name: str) -> None:
    whole = packed(name, [1] * WIDTH * HEIGHT)
    for data in (whole[:-1], whole + b"\0", b""):
        with pytest.raises(CameraError):
            decode(name, data, WIDTH, HEIGHT)


def test_values_beyond_the_depth_and_odd_widths_are_errors() -> None:
    with pytest.raises(CameraError, match="1024"):
        decode("Mono10", packed("Mono16", [1024] * 4), 4, 1)
    with pytest.raises(CameraError, match="multiple of 4"):
        decode("Mono10p", b"\0" * 4, 3, 1)
