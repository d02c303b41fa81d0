"""Statements of an image file beside its pixels: orientation, response, exposure and date.

Pillow reads EXIF data, XMP and colour profiles. Files that contradict themselves are refused.
"""

import io
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from typing import Any

import numpy as np
from PIL import ExifTags, Image

from classify.base.arrays import FloatMap
from classify.base.errors import InputError

# An attribute or an element of an XMP packet, and its value.
_XMP_NUMBER = re.compile(
    rb"[<\s](?:[\w-]+:)?(Orientation|ColorSpace)"
    rb"(?:\s*=\s*[\"']|(?:\s[^<>]*)?>(?:\s*<rdf:value>)?)\s*([^\"'<]*)"
)
# Photoshop's image resources with EXIF data and XMP: a number, an empty name and a length.
_PHOTOSHOP_RESOURCE = re.compile(rb"8BIM\x04[\x22\x24]\0\0(.{4})", re.DOTALL)
# The marker before EXIF data; some programs write it in capitals, with another last byte, or twice.
_EXIF_NAME = re.compile(rb"\A(?:exif\0.)+", re.DOTALL | re.IGNORECASE)
_TIFF_METADATA_TAGS, _EXIF_TEXT = ("XMP", "ImageResources"), "exif:Orientation"
_SRGB, _UNCALIBRATED = 1, 0xFFFF
_RESPONSE_TAGS = ("GrayResponseCurve", "TransferFunction", "ReferenceBlackWhite")
# Largest difference, in 255 steps of lightness, between a profile and a response for both to count
# as equal: rounding alone. Gamma 2.2 differs from sRGB by 8.
_PROFILE_TOLERANCE = 1


@dataclass(frozen=True)
class ImageMetadata:
    """What a file states of its image; the response is ``linear``, ``srgb`` or another name."""

    orientation: int = 1
    response: str | None = None
    exposure_ms: float | None = None
    iso: float | None = None
    f_number: float | None = None
    capture_date: str | None = None


def metadata_of_info(
    info: Mapping[Any, Any], *responses: str, segments: Sequence[bytes] = ()
) -> ImageMetadata:
    """Return what Pillow's `info` of a JPEG or PNG states, and segments with EXIF data or XMP."""
    blobs = [info.get("exif"), info.get("xmp"), str(info.get("XML:com.adobe.xmp", "")).encode()]
    # ImageMagick writes profiles into a PNG as name, length and hexadecimal digits, and the tags
    # of EXIF data as texts.
    raw_profiles = [info[name] for name in info if str(name).startswith("Raw profile type ")]
    blobs += [bytes.fromhex("".join(text.split()[2:])) for text in raw_profiles]
    directories, packets, profiles = _contents([*filter(None, blobs), *segments])
    directories.append({"Orientation": info.get(_EXIF_TEXT, 0)})
    if "icc_profile" in info:
        profiles.insert(0, info["icc_profile"])
    stated_responses = [*responses, *map(_profile_response, profiles)]
    if "srgb" in info:
        stated_responses.append("srgb")
    if "gamma" in info:
        stated_responses.append(power_response(1.0 / info["gamma"] if info["gamma"] else math.inf))
    return _metadata(directories, packets, stated_responses)


def metadata_of_pages(*pages: Any) -> ImageMetadata:
    """Return what the tags of `tifffile` pages state."""
    directories = [{tag.name: tag.value for tag in page.tags} for page in pages]
    directories += [ifd["ExifTag"] for ifd in directories if "ExifTag" in ifd]
    profiles = [ifd["InterColorProfile"] for ifd in directories if "InterColorProfile" in ifd]
    blobs = [bytes(ifd[name]) for ifd in directories for name in _TIFF_METADATA_TAGS if name in ifd]
    embedded, packets, _ = _contents(blobs)
    return _metadata([*directories, *embedded], packets, [*map(_profile_response, profiles)])


def _contents(blobs: Iterable[bytes]) -> tuple[list[Mapping[Any, Any]], list[bytes], list[bytes]]:
    """Return the directories of EXIF data, XMP packets and colour profiles."""
    directories: list[Mapping[Any, Any]] = []
    packets, profiles = [], []
    for blob in blobs:
        resources = [*_PHOTOSHOP_RESOURCE.finditer(blob)]
        ends = [match.end() + int.from_bytes(match[1], "big") for match in resources]
        parts = [blob[match.end() : end] for match, end in zip(resources, ends, strict=True)]
        for part in parts or [blob]:
            data = _EXIF_NAME.sub(b"", part)
            if data.startswith((b"II*\0", b"MM\0*")):
                exif = Image.Exif()
                exif.load(data)
                for ifd in (exif, exif.get_ifd(ExifTags.IFD.Exif)):
                    named = {ExifTags.TAGS.get(tag): value for tag, value in ifd.items()}
                    directories.append(named)
            elif data[36:40] == b"acsp":  # signature of an ICC profile
                profiles.append(data)
            else:
                packets.append(data)
    return directories, packets, profiles


def _metadata(
    directories: Sequence[Mapping[Any, Any]], packets: Sequence[bytes], responses: Sequence[str]
) -> ImageMetadata:
    """Merge all statements: different orientations are an error, the first response counts."""
    fields = [("Orientation", ifd.get("Orientation", 0)) for ifd in directories]
    fields += [("ColorSpace", ifd["ColorSpace"]) for ifd in directories if "ColorSpace" in ifd]
    for packet in packets:
        pairs = _XMP_NUMBER.findall(packet.replace(b"\0", b""))
        fields += [(name.decode(), number.decode(errors="replace")) for name, number in pairs]
    # Cameras that do not know the orientation write 0.
    orientations = {_whole(value) for name, value in fields if name == "Orientation"} - {0}
    if len(orientations) > 1 or not orientations <= {*range(1, 9)}:
        listed = " and ".join(map(str, sorted(orientations)))
        raise InputError(f"its EXIF and XMP data state orientation {listed}; remove the wrong one")
    tags = {name: value for ifd in directories for name, value in ifd.items()}
    responses = [*responses, *(f"a {name}" for name in _RESPONSE_TAGS if name in tags)]
    for space in {_whole(value) for name, value in fields if name == "ColorSpace"}:
        if space != _UNCALIBRATED:
            responses.append("srgb" if space == _SRGB else f"colour space {space}")
    if "Gamma" in tags:
        responses.append(power_response(_number(tags["Gamma"])))
    return ImageMetadata(
        orientation=next(iter(orientations), 1),
        response=next(iter(responses), None),
        exposure_ms=_positive(1e3 * _number(tags.get("ExposureTime"))),
        iso=_positive(_number(tags.get("ISOSpeedRatings"))),
        f_number=_positive(_number(tags.get("FNumber"))),
        capture_date=_date(
            str(tags.get("DateTimeOriginal")), str(tags.get("OffsetTimeOriginal", ""))
        ),
    )


def _whole(value: Any) -> int:
    try:
        return int(value[0] if isinstance(value, (bytes, tuple)) else value)
    except (ArithmeticError, IndexError, TypeError, ValueError):
        raise InputError(
            f"its EXIF or XMP data state orientation or colour space {value!r}, which is no whole "
            "number; remove them"
        ) from None


def _number(value: Any) -> float:
    """Return a number or a fraction as a float; NaN if it is neither."""
    with suppress(TypeError, ValueError, ZeroDivisionError):
        return float(value[0] / value[1] if isinstance(value, tuple) else value)
    return math.nan


def _positive(value: float) -> float | None:
    return value if 0.0 < value < math.inf else None


def power_response(gamma: float) -> str:
    """Return the name of the response whose light is a value to the power of `gamma`."""
    return "linear" if abs(gamma - 1.0) < 0.005 else f"gamma {gamma:.3g}"


def _profile_response(profile: bytes | None) -> str:
    """Compare the lightness of the greys of a colour profile with that of known responses."""
    from PIL import ImageCms

    try:
        source = ImageCms.ImageCmsProfile(io.BytesIO(profile or b""))
        greys = Image.frombytes("L", (256, 1), bytes(range(256)))
        mode = "L" if source.profile.xcolor_space.strip() == "GRAY" else "RGB"
        lab = ImageCms.profileToProfile(
            greys.convert(mode), source, ImageCms.createProfile("LAB"),
            ImageCms.Intent.RELATIVE_COLORIMETRIC, "LAB", flags=ImageCms.Flags.NOOPTIMIZE,
        )  # fmt: skip
        assert lab is not None
    except (OSError, ImageCms.PyCMSError):
        return "a damaged colour profile"
    lightness = np.asarray(lab)[0, :, 0]
    light = np.arange(256, dtype=np.float32) / np.float32(255.0)
    for name, linear in (("linear", light), ("srgb", linear_from_srgb(light))):
        # CIE 1976 lightness.
        expected = np.where(
            linear > 216 / 24389, 116.0 * np.cbrt(linear) - 16.0, linear * 24389 / 27
        )
        if np.abs(lightness - 2.55 * expected).max() < _PROFILE_TOLERANCE:
            return name
    return f"the colour profile {' '.join((source.profile.profile_description or '').split())!r}"


def _date(date: str, offset: str) -> str | None:
    day, _, time = date.strip("\0 ").partition(" ")
    for zone in (offset.strip("\0 "), ""):
        with suppress(ValueError):
            return datetime.fromisoformat(f"{day.replace(':', '-')}T{time}{zone}").isoformat()
    return None


_BT709_WEIGHTS = np.array([0.2126, 0.7152, 0.0722], dtype=np.float32)


def linear_from_srgb(values: FloatMap) -> FloatMap:
    """Linear light, float32 from 0 to 1, of sRGB values from 0 to 1 (IEC 61966-2-1)."""
    linear = np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)
    return linear.astype(np.float32)


def luminance(rgb: FloatMap) -> FloatMap:
    """(H, W) luminance of linear red, green, blue (H, W, 3) float32 (ITU-R BT.709)."""
    return np.asarray(rgb @ _BT709_WEIGHTS, np.float32)
