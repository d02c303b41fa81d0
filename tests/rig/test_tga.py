"""TGA images: pixel values come back from every handled form, and damage is an error."""

import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from classify.errors import InputError
from rig.image_file import read_image
from rig.tga import decode_tga


def header(kind: int, image: np.ndarray, descriptor: int, comment: bytes = b"") -> bytes:
    rows, columns, samples = image.shape
    packed = struct.pack("<BBBHHBHHHHBB", len(comment), 0, kind, 0, 0, 0, 0, 0, columns, rows,
                         8 * samples, descriptor)  # fmt: skip
    return packed + comment


def run_lengths(image: np.ndarray) -> bytes:
    """Packets of equal pixels, and of up to three others."""
    pixels = image.reshape(-1, image.shape[2])
    packets, at = b"", 0
    while at < len(pixels):
        count = 1
        while at + count < len(pixels) and count < 128 and (pixels[at + count] == pixels[at]).all():
            count += 1
        if count > 1:
            packets += bytes([0x80 | (count - 1)]) + pixels[at].tobytes()
        else:
            count = min(3, len(pixels) - at)
            packets += bytes([count - 1]) + pixels[at : at + count].tobytes()
        at += count
    return packets


@given(
    st.tuples(st.integers(1, 20), st.integers(1, 20), st.sampled_from([1, 3, 4])), st.booleans(),
    st.sampled_from([0x00, 0x10, 0x20, 0x30]), st.sampled_from([b"", b"made by hand"]),
    st.integers(0, 2**32 - 1),
)  # fmt: skip
def test_pixel_values_come_back(
    shape: tuple[int, int, int], is_packed: bool, descriptor: int, comment: bytes, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    image = rng.integers(0, 3, shape, np.uint8)
    stored = image if descriptor & 0x20 else image[::-1]
    stored = np.ascontiguousarray(stored[:, ::-1] if descriptor & 0x10 else stored)
    kind = (3 if shape[2] == 1 else 2) | (8 if is_packed else 0)
    body = run_lengths(stored) if is_packed else stored.tobytes()
    decoded = decode_tga(header(kind, image, descriptor, comment) + body + b"a footer")
    expected = image[:, :, 0] if shape[2] == 1 else image[:, :, 2::-1]
    np.testing.assert_array_equal(decoded, expected)


def test_a_file_is_read_by_its_name_and_damage_is_named(tmp_path: Path) -> None:
    image = np.random.default_rng(0).integers(0, 256, (9, 7, 3), np.uint8)
    content = header(2, image, 0x20) + image.tobytes()
    path = tmp_path / "chrome.0.TGA"
    path.write_bytes(content)
    np.testing.assert_array_equal(read_image(path), image[:, :, ::-1])
    for damaged, cause in (
        (content[:-1], "truncated"),
        (content[:10], "truncated"),
        (header(1, image, 0x20) + image.tobytes(), "type 1"),
        (header(10, image, 0x20) + run_lengths(image)[:-4], "truncated"),
        (header(3, np.zeros((0, 4, 1), np.uint8), 0x20), "0 px"),
    ):
        path.write_bytes(damaged)
        with pytest.raises(InputError, match=cause):
            read_image(path)
