"""Import of photographs: stored values, refused files, and the command."""

import json
import struct
import sys
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import pytest
import tifffile

from capture import CapturedSet, SetRejected, import_images
from classify import Lighting
from classify.base.errors import InputError
from tests.image_files import (
    LINEAR_RAW,
    chunk,
    dng,
    private_exif,
    with_chunks,
    with_segments,
)

RING = Lighting.ring(45.0)
SHAPE = (12, 17)
Photographs = Callable[..., list[Path]]
Refused = Callable[..., str]


def pattern(dtype: type[np.uint8 | np.uint16], channels: int = 0) -> npt.NDArray[Any]:
    """Random pixels, none of them saturated."""
    shape = SHAPE if channels == 0 else (*SHAPE, channels)
    return np.random.default_rng(5).integers(0, np.iinfo(dtype).max, shape).astype(dtype)


def written(path: Path, image: npt.NDArray[Any]) -> Path:
    """Write an RGB or grey image in the format of the suffix."""
    if path.suffix in (".tif", ".tiff"):
        tifffile.imwrite(path, image, photometric="rgb" if image.ndim == 3 else "minisblack")
    else:
        stored = np.ascontiguousarray(image[:, :, ::-1]) if image.ndim == 3 else image
        assert cv2.imwrite(str(path), stored)
    return path


@pytest.fixture
def four(tmp_path: Path) -> Photographs:
    """Write one image to four files and return their paths."""

    def write(image: npt.NDArray[Any], suffix: str = ".png") -> list[Path]:
        return [written(tmp_path / f"image{light}{suffix}", image) for light in range(4)]

    return write


def stored(paths: list[Path], **options: Any) -> CapturedSet:
    """The set of photographs under a ring; they may show the same image."""
    return import_images(paths, RING, accept=("equal-images", "saturation"), **options)


def srgb(values: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
    """Undo the sRGB response (IEC 61966-2-1) of values in [0, 1]."""
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


# stored values


@pytest.mark.parametrize("suffix", [".png", ".tif", ".tiff"])
@pytest.mark.parametrize(("dtype", "top"), [(np.uint8, 255), (np.uint16, 65535)])
def test_linear_grey_keeps_its_pixel_values(
    four: Photographs, suffix: str, dtype: type[np.uint8 | np.uint16], top: int
) -> None:
    image = pattern(dtype)
    captured = stored(four(image, suffix), label="oak")
    np.testing.assert_array_equal(captured.images, np.stack([image] * 4))
    metadata = captured.metadata
    assert (metadata.full_scale, metadata.bit_depth) == (top, 8 if top == 255 else 16)
    assert not metadata.simulated
    assert metadata.label == "oak"
    assert metadata.gamma == "linear"
    assert [record.source_file for record in metadata.images] == [
        f"image{n}{suffix}" for n in range(4)
    ]
    assert captured.ambient is None
    assert captured.lighting == RING


@pytest.mark.parametrize("suffix", [".png", ".tif"])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_colour_becomes_linear_luminance(
    four: Photographs, suffix: str, dtype: type[np.uint8 | np.uint16]
) -> None:
    image = pattern(dtype, channels=3)
    captured = stored(four(image, suffix))
    expected = image @ np.array([0.2126, 0.7152, 0.0722]) * (65535 / np.iinfo(dtype).max)
    np.testing.assert_allclose(captured.images[2], expected, atol=0.51)
    assert captured.metadata.full_scale == 65535


@pytest.mark.parametrize("channels", [0, 3])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_srgb_is_undone(
    four: Photographs, channels: int, dtype: type[np.uint8 | np.uint16]
) -> None:
    image = pattern(dtype, channels)
    captured = stored(four(image), gamma="srgb")
    linear = srgb(image / np.iinfo(dtype).max)
    expected = linear @ np.array([0.2126, 0.7152, 0.0722]) if channels else linear
    np.testing.assert_allclose(captured.images[1], 65535 * expected, atol=0.6)
    assert captured.metadata.gamma == "srgb"


def test_a_pixel_with_one_saturated_channel_is_saturated(four: Photographs) -> None:
    image = np.full((*SHAPE, 3), 100, np.uint8)
    image[4, 5] = (100, 100, 255)
    captured = stored(four(image))
    assert captured.images[0, 4, 5] == 65535
    surface = captured.solve()
    assert surface.saturated[4, 5]
    assert surface.saturated.sum() == 1


def test_grey_and_colour_may_be_mixed(four: Photographs) -> None:
    grey = pattern(np.uint8)
    paths = four(grey)
    written(paths[2], np.dstack([grey] * 3))
    captured = stored(paths)
    np.testing.assert_allclose(captured.images[2], captured.images[0], atol=1)
    np.testing.assert_array_equal(captured.images[0], grey.astype(np.uint16) * 257)


def test_an_ambient_image_comes_last_and_is_subtracted(four: Photographs, tmp_path: Path) -> None:
    paths = four(np.full(SHAPE, 90, np.uint8))
    ambient = written(tmp_path / "ambient.png", np.full(SHAPE, 40, np.uint8))
    captured = stored(paths, ambient=ambient)
    assert captured.ambient is not None
    assert (captured.ambient == 40).all()
    assert captured.metadata.images[-1].light is None
    assert captured.metadata.images[-1].source_file == "ambient.png"
    # Flat and facing the camera under four equal lights: (90 - 40) / 255 = albedo cos 45.
    np.testing.assert_allclose(captured.solve().albedo, 50 / 255 / np.cos(np.pi / 4), rtol=1e-5)


def test_a_jpeg_needs_gamma(four: Photographs) -> None:
    paths = four(np.full(SHAPE, 128, np.uint8), ".jpg")
    with pytest.raises(InputError, match=r"image0\.jpg: .*--gamma srgb"):
        stored(paths)
    assert (stored(paths, gamma="linear").images == 128).all()
    expected = round(65535 * float(srgb(np.array(128 / 255))))
    assert (stored(paths, gamma="srgb").images == expected).all()


# the stated response

STATED = {
    "linear": chunk(b"gAMA", struct.pack(">I", 100_000)),
    "srgb": chunk(b"sRGB", b"\0"),
    "gamma 1.8": chunk(b"gAMA", struct.pack(">I", 55_556)),
}


def state(path: Path, response: str) -> None:
    """Write the response into a PNG or JPEG."""
    content = path.read_bytes()
    if path.suffix == ".png":
        path.write_bytes(with_chunks(content, STATED[response]))
    else:
        assert response == "srgb"
        data = b"Exif\0\0" + private_exif(ColorSpace=1)
        path.write_bytes(with_segments(content, data))


@pytest.mark.parametrize(
    ("suffix", "response"), [(".png", "linear"), (".png", "srgb"), (".jpg", "srgb")]
)
def test_photographs_are_read_by_the_response_that_they_state(
    four: Photographs, suffix: str, response: Any
) -> None:
    paths = four(np.full(SHAPE, 128, np.uint8), suffix)
    for path in paths:
        state(path, response)
    captured = stored(paths)
    expected = 128 if response == "linear" else round(65535 * float(srgb(np.array(128 / 255))))
    assert (captured.images == expected).all()
    metadata = captured.metadata
    assert (metadata.gamma, metadata.gamma_source) == (response, "stated")
    assert not any("--gamma" in warning for warning in metadata.warnings)


@pytest.mark.parametrize(("response", "gamma"), [("linear", "srgb"), ("srgb", "linear")])
def test_a_gamma_that_contradicts_the_files_is_a_warning(
    four: Photographs, response: str, gamma: Any
) -> None:
    paths = four(pattern(np.uint8))
    for path in paths[2:]:
        state(path, response)
    metadata = stored(paths, gamma=gamma).metadata
    assert (metadata.gamma, metadata.gamma_source) == (gamma, "given")
    (warning,) = [each for each in metadata.warnings if "--gamma" in each]
    assert warning.startswith("image2.png and 1 more: ")
    assert response in warning


def test_a_response_that_is_not_undone_or_not_of_all_is_refused(four: Photographs) -> None:
    paths = four(pattern(np.uint8))
    state(paths[0], "linear")
    refuse(paths, r"image1\.png: states no response, but .*image0\.png states linear; give --gamma")
    for path in paths:
        written(path, pattern(np.uint8))
        state(path, "gamma 1.8")
    refuse(paths, r"image0\.png: states gamma 1\.8; .* --gamma linear or --gamma srgb")
    assert stored(paths, gamma="srgb").metadata.gamma_source == "given"


@pytest.mark.parametrize(
    ("dtype", "channels", "warned"),
    [(np.uint8, 0, True), (np.uint16, 0, False), (np.uint16, 3, True)],
)
def test_an_unknown_response_counts_as_linear_with_a_word(
    four: Photographs, dtype: type[np.uint8 | np.uint16], channels: int, warned: bool
) -> None:
    metadata = stored(four(pattern(dtype, channels))).metadata
    assert (metadata.gamma, metadata.gamma_source) == ("linear", "assumed")
    assert [*metadata.facts][-1] == ("response", "linear (assumed)")
    assert any("--gamma" in warning for warning in metadata.warnings) == warned


# the date


@pytest.mark.parametrize(
    ("date", "offset", "photographed", "acquired"),
    [
        ("2024:05:01 12:34:56", "+02:00", "2024-05-01T12:34:56+02:00", "2024-05-01T10:34:56"),
        ("2024:05:01 12:34:56", "", "2024-05-01T12:34:56", "2024-05-01T12:34:56"),
        ("", "", None, None),
    ],
)
def test_the_date_of_the_photographs_is_that_of_the_set(
    four: Photographs, tmp_path: Path, date: str, offset: str,
    photographed: str | None, acquired: str | None,
) -> None:  # fmt: skip
    paths = four(pattern(np.uint8))
    data = private_exif(DateTimeOriginal=date, OffsetTimeOriginal=offset)
    paths[1].write_bytes(with_chunks(paths[1].read_bytes(), chunk(b"eXIf", data)))
    captured = stored(paths)
    metadata = captured.metadata
    assert (metadata.photographed, metadata.capture_date) == (photographed, photographed)
    facts = dict(metadata.facts)
    assert (facts.get("captured"), facts["imported"]) == (photographed, metadata.created_utc)
    captured.save(tmp_path / "a.ome.tif")
    with tifffile.TiffFile(tmp_path / "a.ome.tif") as file:
        root = ET.fromstring(file.ome_metadata)
    found = root.findtext(".//{*}AcquisitionDate")
    assert found == acquired


@pytest.mark.parametrize(("denominator", "is_named"), [(100, False), (102, False), (50, True)])
def test_exposures_that_differ_are_named(
    four: Photographs, denominator: int, is_named: bool
) -> None:
    paths = four(pattern(np.uint8))
    for path, value in zip(paths, (100, 100, 100, denominator), strict=True):
        data = private_exif(ExposureTime=(1, value))
        path.write_bytes(with_chunks(path.read_bytes(), chunk(b"eXIf", data)))
    warnings = stored(paths).metadata.warnings
    assert any("state exposures of 10 to 20 ms" in text for text in warnings) == is_named


@pytest.mark.parametrize(
    ("setting", "equal", "unequal", "text"),
    [
        ("ISOSpeedRatings", 100, 200, "ISO values of 100 to 200"),
        ("FNumber", (56, 10), (8, 1), "F-numbers of 5.6 to 8"),
    ],
)
def test_iso_values_and_f_numbers_that_differ_are_named(
    four: Photographs, setting: str, equal: Any, unequal: Any, text: str
) -> None:
    for last, is_named in ((equal, False), (unequal, True)):
        paths = four(pattern(np.uint8))
        for path, value in zip(paths, (equal, equal, equal, last), strict=True):
            data = private_exif(ExposureTime=(1, 100), **{setting: value})
            path.write_bytes(with_chunks(path.read_bytes(), chunk(b"eXIf", data)))
        warnings = stored(paths).metadata.warnings
        assert any(text in warning for warning in warnings) == is_named


@pytest.mark.parametrize(
    ("gain", "light", "is_named"), [(1.0, 1, False), (0.8, 1, True), (0.8, 0, False)]
)
def test_a_white_balance_that_differs_is_named(
    four: Photographs, tmp_path: Path, gain: float, light: int, is_named: bool
) -> None:
    """Light without blue has one colour under every white balance."""
    image = pattern(np.uint16, 3) // 2
    image[:, :, 0] *= light
    paths = four(image)
    blue, *others = np.moveaxis(image, -1, 0)
    balanced = np.dstack([gain * blue, *others]).astype(np.uint16)
    paths[2] = written(tmp_path / "balanced.png", balanced)
    ambient = written(tmp_path / "ambient.png", image[:, :, ::-1] // 20)
    warnings = stored(paths, ambient=ambient).metadata.warnings
    assert any("automatic white balance" in text for text in warnings) == is_named


def test_a_file_name_that_is_not_utf_8_is_escaped(four: Photographs, tmp_path: Path) -> None:
    paths = four(pattern(np.uint8))
    paths[3] = paths[3].rename(tmp_path / "odd\udcff.png")
    captured = stored(paths)
    captured.save(tmp_path / "a.ome.tif")
    read = CapturedSet.load(tmp_path / "a.ome.tif")
    assert read.metadata.images[3].source_file == "odd\\udcff.png"


# depth


@pytest.mark.parametrize(
    ("dtype", "largest", "shift", "bits", "full_scale"),
    [
        (np.uint8, 200, 0, 8, 255),
        (np.uint16, 250, 0, 8, 255),
        (np.uint16, 900, 0, 10, 1023),
        (np.uint16, 4095, 0, 12, 4095),
        (np.uint16, 4096, 0, 14, 16_383),
        (np.uint16, 40_000, 0, 16, 65_535),
        (np.uint16, 4095, 4, 12, 65_520),
        (np.uint16, 16_383, 2, 14, 65_532),
    ],
)
def test_the_depth_is_guessed_from_the_largest_value(
    four: Photographs, dtype: Any, largest: int, shift: int, bits: int, full_scale: int
) -> None:
    image = np.random.default_rng(2).integers(0, largest, SHAPE).astype(dtype)
    image.flat[0] = largest
    captured = stored(four(image << shift, ".tif"))
    metadata = captured.metadata
    assert (metadata.bit_depth, metadata.full_scale) == (bits, full_scale)
    np.testing.assert_array_equal(captured.images[1], image.astype(np.uint16) << shift)
    said = [each for each in metadata.warnings if "are taken for" in each]
    assert len(said) == (dtype == np.uint16 and bits < 16)
    assert all(f"value is {largest << shift};" in e for e in said)


def test_dark_photographs_that_state_srgb_have_the_depth_of_the_file(four: Photographs) -> None:
    image = (pattern(np.uint16) // 8).astype(np.uint16)
    paths = four(image)
    for path in paths:
        state(path, "srgb")
    captured = stored(paths)
    assert captured.metadata.bit_depth == 16
    assert not any("are taken for" in warning for warning in captured.metadata.warnings)
    expected = np.rint(65535 * srgb(image / 65535))
    assert np.abs(captured.images[1] - expected).max() <= 1


def test_saturation_is_that_of_the_given_depth(four: Photographs) -> None:
    """A pixel of 12-bit data in a file of 16 bits was never saturated."""
    image = np.full(SHAPE, 900, np.uint16)
    image[3, 5] = 4095
    for options in ({}, {"bits": 12}):
        assert stored(four(image, ".tif"), **options).solve().saturated[3, 5]
    deep = stored(four(image, ".tif"), bits=16)
    assert deep.metadata.full_scale == 65_535
    assert not any("are taken for" in warning for warning in deep.metadata.warnings)
    assert not deep.solve().saturated.any()
    colour = stored(four(np.dstack([image] * 3), ".tif"), bits=12)
    assert (colour.metadata.bit_depth, colour.metadata.full_scale) == (12, 65_535)
    assert colour.images[0, 3, 5] == 65_535
    assert abs(int(colour.images[0, 0, 0]) - 900 / 4095 * 65_535) <= 1
    shifted = stored(four(image << 4, ".tif"), bits=12)
    assert shifted.metadata.full_scale == 65_520
    assert shifted.solve().saturated[3, 5]


# mask, crop and orientation


def test_a_crop_cuts_all_images_and_the_mask_alike(four: Photographs, tmp_path: Path) -> None:
    image = pattern(np.uint8)
    ambient = written(tmp_path / "ambient.png", image // 4)
    grey = np.zeros(SHAPE, np.uint8)
    grey[4:9, 3:11] = 200
    grey[8, 10] = 127
    mask = written(tmp_path / "mask.png", grey)
    captured = stored(four(image), ambient=ambient, mask=mask, crop=(2, 3, 10, 6))
    np.testing.assert_array_equal(captured.images[3], image[3:9, 2:12])
    np.testing.assert_array_equal(captured.ambient, image[3:9, 2:12] // 4)
    np.testing.assert_array_equal(captured.mask, grey[3:9, 2:12] > 127)
    captured.save(tmp_path / "a.ome.tif")
    read = CapturedSet.load(tmp_path / "a.ome.tif")
    assert (read.metadata.crop, read.metadata.mask_file) == ((2, 3, 10, 6), "mask.png")
    assert read.mask is not None
    assert not read.solve().valid[~read.mask].any()


@pytest.mark.parametrize(("filled", "warned"), [(False, True), (True, False)])
def test_a_mask_that_is_the_outline_of_the_part_is_a_warning(
    four: Photographs, tmp_path: Path, filled: bool, warned: bool
) -> None:
    grey = np.zeros(SHAPE, np.uint8)
    grey[2:10, 2:15] = 255
    grey[3:9, 3:14] = 255 * filled
    mask = written(tmp_path / "mask.png", grey)
    warnings = stored(four(pattern(np.uint8)), mask=mask).metadata.warnings
    assert any("encloses 32.4% that is black" in text for text in warnings) == warned


def test_a_mask_must_cover_the_frame_and_show_the_part(four: Photographs, tmp_path: Path) -> None:
    paths = four(pattern(np.uint8))
    small = written(tmp_path / "small.png", np.full((5, 6), 255, np.uint8))
    refuse(paths, r"small\.png: 6 x 5 px, but the photographs have 17 x 12 px", mask=small)
    black = written(tmp_path / "black.png", np.full(SHAPE, 100, np.uint8))
    refuse(
        paths,
        r"black\.png: the mask is black everywhere, with values up to 100 of 255;",
        mask=black,
    )
    corner = np.zeros(SHAPE, np.uint8)
    corner[0, 0] = 255
    elsewhere = written(tmp_path / "corner.png", corner)
    refuse(paths, "the mask is black in all of the crop", mask=elsewhere, crop=(5, 5, 4, 4))


def test_photographs_are_turned_upright_and_must_agree(four: Photographs, tmp_path: Path) -> None:
    image = pattern(np.uint8)
    paths = four(image, ".tif")
    for path in paths:
        tifffile.imwrite(path, image, photometric="minisblack", extratags=[(274, 3, 1, 6, True)])
    upright = np.rot90(image, -1)
    captured = stored(paths)
    np.testing.assert_array_equal(captured.images[0], upright)
    assert "rotated by their EXIF orientation 6" in "".join(captured.metadata.warnings)
    mask = written(tmp_path / "mask.png", np.full(upright.shape, 255, np.uint8))
    assert stored(paths, mask=mask).mask is not None
    mask = tmp_path / "mask.tif"
    light = (image > 128).astype(np.uint8) * 255
    for orientation, message in (
        (6, ""),
        (8, r"mask\.tif: EXIF orientation 8, but the .* have 6;"),
    ):
        tag = (274, 3, 1, orientation, True)
        tifffile.imwrite(mask, light, photometric="minisblack", extratags=[tag])
        if message:
            refuse(paths, message, mask=mask)
        else:
            np.testing.assert_array_equal(stored(paths, mask=mask).mask, upright > 128)
    written(paths[2], image)
    refuse(paths, r"image2\.tif: EXIF orientation 1, but .*image0\.tif has 6; keep the camera")


# DNG


def raws(folder: Path, values: npt.NDArray[np.uint16], **options: Any) -> list[Path]:
    paths = [folder / f"{light}.dng" for light in range(4)]
    for path in paths:
        path.write_bytes(dng(values, **options))
    return paths


def test_a_dng_is_linear_from_its_black_to_its_white_level(tmp_path: Path) -> None:
    pytest.importorskip("rawpy")
    levels = (64, 564, 1064, 2064)
    raw = np.repeat(np.repeat(np.array(levels, np.uint16), 16)[None], 32, axis=0)
    raw[20:24, 20:24] = 4095
    paths = raws(tmp_path, raw)
    captured = stored(paths)
    assert (captured.metadata.full_scale, captured.metadata.gamma) == (65_535, "linear")
    for number, level in enumerate(levels):
        found = captured.images[1, 4, 16 * number + 8]
        assert found == pytest.approx((level - 64) / (4095 - 64) * 65_535, abs=2.0)
    assert captured.solve().saturated[21, 21]
    assert captured.solve().saturated.sum() < 64
    turned = stored(raws(tmp_path, raw, orientation=6))
    np.testing.assert_array_equal(turned.images[0], np.rot90(captured.images[0], -1))
    for options in ({"gamma": "srgb"}, {"bits": 12}):
        refuse(paths, "a DNG is linear and states its depth", **options)
    (tmp_path / "0.dng").write_bytes(b"II*\0 no raw data")
    refuse(paths, r"0\.dng: not a complete DNG")
    paths[0] = written(tmp_path / "0.tif", pattern(np.uint16))
    refuse(paths, "3 of 4 photographs are DNG; give all or none as DNG")


def test_saturated_pixels_of_a_linear_raw_image_are_counted(tmp_path: Path) -> None:
    pytest.importorskip("rawpy")
    raw = np.full((32, 48, 3), 900, np.uint16)
    raw[:, 20:] = 4095
    options = {"kind": LINEAR_RAW, "black": (64, 60, 128), "white": (4095, 4095, 4095)}
    refused = raws(tmp_path, raw, **options)
    with pytest.raises(SetRejected, match=r"58\.3% .*saturated at 65535"):
        import_images(refused, RING, accept=("equal-images",))


def test_a_dng_without_rawpy_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "rawpy", None)
    paths = raws(tmp_path, pattern(np.uint16))
    refuse(paths, r"0\.dng: a DNG is read by rawpy, .* pip install 'ps4rig\[dng\]'")


# errors


def refuse(paths: list[Path], message: str, **options: Any) -> None:
    with pytest.raises(InputError, match=message) as caught:
        import_images(paths, RING, **options)
    assert "\n" not in str(caught.value)


def test_the_numbers_of_images_and_lights_must_agree(four: Photographs) -> None:
    refuse(four(pattern(np.uint8))[:3], "3 images for 4 lights; give one image each, .* --tilts")


@pytest.mark.parametrize(("slant_deg", "warned"), [(0.785, True), (12.0, False)])
def test_lights_at_a_slant_in_radians_are_a_warning(
    four: Photographs, slant_deg: float, warned: bool
) -> None:
    accept = ("equal-images", "saturation")
    captured = import_images(four(pattern(np.uint8)), Lighting.ring(slant_deg), accept=accept)
    found = [text for text in captured.metadata.warnings if "within 0.785 degrees" in text]
    assert bool(found) == warned


def test_images_must_have_one_size_and_depth(four: Photographs, tmp_path: Path) -> None:
    paths = four(pattern(np.uint8))
    ambient = written(tmp_path / "ambient.png", pattern(np.uint8)[:5])
    refuse(paths, r"ambient\.png: 17 x 5 px", ambient=ambient)
    written(paths[2], pattern(np.uint8)[:-1])
    refuse(paths, r"image2\.png: 17 x 11 px, but .*image0\.png has 17 x 12 px")
    written(paths[2], pattern(np.uint16))
    refuse(paths, r"image2\.png: uint16, but .*image0\.png is uint8")


# the command


def test_an_output_never_replaces_an_input(
    four: Photographs, tmp_path: Path, refused: Refused
) -> None:
    """Without OUT the last photograph would be the output."""
    paths = four(pattern(np.uint8), ".ome.tif")
    vectors = zip(paths, RING.directions.tolist(), strict=True)
    lights = tmp_path / "l.json"
    lights.write_text(json.dumps([{"file": p.name, "direction": v} for p, v in vectors]))
    before = [path.read_bytes() for path in paths]
    for force in ((), ("--force",)):
        line = refused("import", *paths, "--lights", lights, *force)
        assert line.startswith(f"{paths[3]}: is an input")
    assert [path.read_bytes() for path in paths] == before


def test_lights_without_image_names_need_images(tmp_path: Path, refused: Refused) -> None:
    (tmp_path / "l.json").write_text(json.dumps(RING.directions.tolist()))
    line = refused("import", tmp_path / "a.ome.tif", "--lights", tmp_path / "l.json")
    assert line.startswith(f"{tmp_path}/l.json: gives no image names")
