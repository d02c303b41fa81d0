"""Request numbers and offsets equal those that a C compiler takes from ``linux/videodev2.h``."""

import ctypes
import struct

import pytest

from rig.cameras.v4l2 import abi


@pytest.mark.parametrize(
    ("name", "number"),
    [
        ("QUERYCAP", 0x8068_5600),
        ("ENUM_FMT", 0xC040_5602),
        ("S_FMT", 0xC0D0_5605),
        ("REQBUFS", 0xC014_5608),
        ("QUERYBUF", 0xC058_5609),
        ("QBUF", 0xC058_560F),
        ("DQBUF", 0xC058_5611),
        ("STREAMON", 0x4004_5612),
        ("STREAMOFF", 0x4004_5613),
        ("G_PARM", 0xC0CC_5615),
        ("S_PARM", 0xC0CC_5616),
        ("QUERYMENU", 0xC02C_5625),
        ("S_PRIORITY", 0x4004_5644),
        ("G_EXT_CTRLS", 0xC020_5647),
        ("S_EXT_CTRLS", 0xC020_5648),
        ("ENUM_FRAMESIZES", 0xC02C_564A),
        ("QUERY_EXT_CTRL", 0xC0E8_5667),
    ],
)
def test_request_numbers_are_those_of_the_kernel(name: str, number: int) -> None:
    assert abi.Vidioc[name] == number


def test_field_offsets_are_those_of_the_kernel() -> None:
    assert abi.Format.fmt.offset == 8
    assert abi.Buffer.timestamp.offset == 24
    assert abi.Buffer.sequence.offset == 56
    assert abi.Buffer.m.offset == 64
    assert abi.Buffer.length.offset == 72
    assert abi.ExtControl.payload.offset == 12
    assert ctypes.sizeof(abi.ExtControl) == 20
    assert abi.ExtControls.controls.offset == 24


def test_a_buffer_is_decoded_from_the_kernels_bytes() -> None:
    fixed = struct.pack("<5I4xqq", 2, 1, 640, 0x2000, 1, 12, 500_000)
    rest = struct.pack("<16xIIQIIi4x", 77, 1, 4096, 8192, 0, 0)
    buffer = abi.Buffer.from_buffer_copy(fixed + rest)
    assert (buffer.index, buffer.bytesused, buffer.sequence) == (2, 640, 77)
    assert (buffer.timestamp.tv_sec, buffer.timestamp.tv_usec) == (12, 500_000)
    assert (buffer.m.offset, buffer.length) == (4096, 8192)


def test_a_code_is_four_printable_characters() -> None:
    assert abi.fourcc("Y10 ") == 0x2030_3159
    assert abi.fourcc_text(0x2030_3159) == "Y10 "
    assert abi.fourcc_text(0xB036_3159) == "Y16."
    assert abi.fourcc_text(0) == "...."


def test_a_name_ends_at_its_first_zero() -> None:
    assert abi.text(b"vivid\0rest") == "vivid"
    assert abi.text(b"\xff\0") == "\N{REPLACEMENT CHARACTER}"
