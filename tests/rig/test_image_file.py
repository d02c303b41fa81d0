"""Image files: pixel values come back, and damage is an error without other output."""

import os
import struct
import zlib
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import pytest
import tifffile

from classify.base.errors import InputError
from rig.image_file import read_image_file
from tests.image_files import chunk, encoded

Pixels = npt.NDArray[Any]
SMOOTH = cv2.GaussianBlur(
    np.random.default_rng(5).integers(0, 255, (120, 170, 3), np.uint8), (0, 0), 2.0
)


def refused(path: Path, content: bytes, capfd: pytest.CaptureFixture[str]) -> str:
    """Write the file, which must be refused with one line and without any other output."""
    path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        read_image_file(path)
    message = str(caught.value)
    assert "\n" not in message
    assert capfd.readouterr() == ("", "")
    return message.removeprefix(f"{path}: ")


def png(pixels: bytes, *extra: bytes, side: tuple[int, int] = (4, 3), form: str = "80000") -> bytes:
    """A PNG of these rows; `form` is depth, colour type, compression, filter and interlace."""
    header = struct.pack(">II", *side) + bytes(map(int, form))
    chunks = (chunk(b"IHDR", header), *extra, chunk(b"IDAT", pixels), chunk(b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks)


ROWS = zlib.compress(bytes(3 * 5))


def test_an_interlaced_png_with_ancillary_chunks_is_read(tmp_path: Path, capfd: Any) -> None:
    """The colour profile is damaged, and libpng would print a warning."""
    rows = [bytes([0, value]) for value in (1, 2)] + [bytes([0, 3, 4]), bytes([0, 5, 6, 7, 8])]
    content = png(
        zlib.compress(b"".join(rows)), chunk(b"iCCP", b"x\0\0zzz"), side=(4, 2), form="80001"
    )
    (tmp_path / "a.png").write_bytes(content)
    expected = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    capfd.readouterr()
    image = read_image_file(tmp_path / "a.png")[0]
    np.testing.assert_array_equal(image, expected)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("options", [(), (cv2.IMWRITE_JPEG_PROGRESSIVE, 1)])
@pytest.mark.parametrize("image", [SMOOTH, SMOOTH[:, :, 0]], ids=["colour", "grey"])
def test_a_jpeg_with_bytes_after_its_end_is_decoded_as_by_opencv(
    tmp_path: Path, image: Pixels, options: tuple[int, ...]
) -> None:
    content = encoded(".jpg", image, *options)
    (tmp_path / "a.jpg").write_bytes(content + b"a thumbnail")
    expected = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    expected = expected[:, :, ::-1] if image.ndim == 3 else expected
    np.testing.assert_array_equal(read_image_file(tmp_path / "a.jpg")[0], expected)


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".tif"])
def test_a_file_cut_off_anywhere_is_refused(tmp_path: Path, capfd: Any, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    tifffile.imwrite(tmp_path / "a.tif", SMOOTH, photometric="rgb")
    whole = path.read_bytes() if suffix == ".tif" else encoded(suffix, SMOOTH)
    # What follows the last pixel of a TIFF is not needed.
    last = len(whole) - (0 if suffix == ".tif" else 2)
    for length in (0, 1, 8, 50, *range(100, last, max(1, last // 30)), last - 1):
        message = refused(path, whole[:length], capfd)
        assert message.endswith("it may be truncated")


@pytest.mark.parametrize("options", [(), (cv2.IMWRITE_JPEG_PROGRESSIVE, 1)])
def test_a_damaged_jpeg_is_refused(tmp_path: Path, capfd: Any, options: tuple[int, ...]) -> None:
    """OpenCV fills in grey where a file was cut before its end marker, or bytes were replaced."""
    whole = encoded(".jpg", SMOOTH, *options)
    for share in (0.3, 0.6, 0.9):
        cut = int(share * len(whole))
        for content in (whole[:cut] + b"\xff\xd9", whole[:cut] + b"\xff" * 64 + whole[cut + 64 :]):
            message = refused(tmp_path / "a.jpg", content, capfd)
            assert message.startswith("not a complete JPEG")


def test_a_damaged_png_is_refused(tmp_path: Path, capfd: Any) -> None:
    whole = encoded(".png", SMOOTH)
    half = len(whole) // 2
    flipped = bytearray(whole)
    flipped[half] ^= 4
    for content in (whole[:half] + whole[-12:], bytes(flipped)):
        assert refused(tmp_path / "a.png", content, capfd).startswith("not a complete PNG")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (png(ROWS, form="70000"), "not a complete PNG"),
        (png(ROWS, form="81000"), "not a complete PNG"),
        (png(ROWS, form="83000"), "not a complete PNG"),
        (png(ROWS, side=(0, 3)), "0 x 3 px"),
        (png(b"no zlib stream"), "not a complete PNG"),
        (png(zlib.compress(bytes(14))), "Not enough image data"),
        (png(zlib.compress(b"\x05" * 15)), "bad adaptive filter value"),
        (png(ROWS, side=(60_000, 60_000)), "sides up to 32768"),
        (png(ROWS, side=(30_000, 30_000)), r"declares 900000000 bytes "),
    ],
)
def test_an_invalid_png_is_refused(
    tmp_path: Path, capfd: Any, content: bytes, message: str
) -> None:
    assert message in refused(tmp_path / "a.png", content, capfd)


def test_a_small_file_that_declares_gigabytes_is_refused(tmp_path: Path, capfd: Any) -> None:
    path = tmp_path / "a.tif"
    tifffile.imwrite(path, np.zeros((9000, 9000), np.uint8), compression="zlib")
    assert "declares 81171000 bytes of pixels" in refused(path, path.read_bytes(), capfd)
    jpeg = bytearray(encoded(".jpg", SMOOTH))
    start = jpeg.index(b"\xff\xc0")  # the frame header: length, depth, rows, columns
    jpeg[start + 5 : start + 9] = struct.pack(">HH", 30_000, 30_000)
    assert "declares 2700000000 bytes" in refused(tmp_path / "a.jpg", bytes(jpeg), capfd)


@pytest.mark.parametrize("compression", [1, 5])
def test_a_damaged_tiff_is_refused(tmp_path: Path, capfd: Any, compression: int) -> None:
    whole = encoded(".tif", SMOOTH, cv2.IMWRITE_TIFF_COMPRESSION, compression)
    directory = int.from_bytes(whole[4:8], "little")
    for content in (whole[:200], whole[: directory + 4] + b"\xff" * 60 + whole[directory + 64 :]):
        assert "not a complete TIFF" in refused(tmp_path / "a.tif", content, capfd)


def test_other_files_are_named(tmp_path: Path, capfd: Any) -> None:
    for name, content, message in (
        ("a.gif", b"GIF89a", "images come as PNG, JPEG, TIFF, TGA or DNG"),
        ("a.CR2", b"II*\0", "images come as PNG, JPEG, TIFF, TGA or DNG; convert it to DNG"),
        ("a.HEIC", b"ftyp", "images come as PNG, JPEG, TIFF, TGA or DNG; save it as TIFF"),
        ("a.png", b"hello IEND", "not a complete PNG"),
        ("a.jpg", b"hello \xff\xd9", "not a complete JPEG"),
        ("a.tif", b"hello", "not a complete TIFF image"),
    ):
        assert refused(tmp_path / name, content, capfd).startswith(message)
    (tmp_path / "folder.png").mkdir()
    os.mkfifo(tmp_path / "pipe.png")
    (tmp_path / "link.png").symlink_to("/dev/zero")
    for name in ("none", "folder", "pipe", "link"):
        with pytest.raises(InputError, match=rf"{name}\.png: (no such|cannot be)"):
            read_image_file(tmp_path / f"{name}.png")
