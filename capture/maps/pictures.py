"""Maps as pictures: 8-bit RGB arrays, PNG and JPEG files, and data URIs of an HTML page."""

from __future__ import annotations

import base64
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from capture.sets.captured_set import CapturedSet
from classify import Lighting
from classify.base.arrays import Array, BoolArray, FloatMap
from classify.shadow_rule import NO_DROPPED_LIGHT

Picture = npt.NDArray[np.uint8]
PICTURE_PX = 512
"""Longer side of a picture by default, twice the width of a map on the page."""
# Percentile of the values at the end of a colour scale, so that outliers do not pale the others.
_SCALE_PERCENT = 99.5
_SHADOW_COLOURS = np.array(
    [[235, 235, 235], [250, 190, 80], [225, 105, 40], [150, 35, 45], [40, 10, 40]], dtype=np.uint8
)
# Colour of NaN. The signed scale lacks it, so that a pixel without a slope does not look flat.
_INVALID_COLOUR = (200, 200, 200)
_NO_LIGHT_COLOUR = (235, 235, 235)
GREYS = np.repeat(np.arange(256, dtype=np.uint8)[:, None], 3, axis=1)
_RELIEF_LIGHT = Lighting.from_angles([135.0], 55.0).directions[0].astype(np.float32)
_FLAT_GREY = 0.5 + 0.5 * float(_RELIEF_LIGHT[2])
_MAX_CONTRAST = 6.0  # beyond it the noise of a smooth part looks like relief


def _blue_white_red() -> Picture:
    position, white = np.linspace(-1.0, 1.0, 256)[:, None], 247.0
    end_colour = np.where(position > 0, (178.0, 24.0, 43.0), (33.0, 102.0, 172.0))
    colours: Picture = np.rint(white + np.abs(position) * (end_colour - white)).astype(np.uint8)
    return colours


_BLUE_WHITE_RED = _blue_white_red()


@dataclass(frozen=True, eq=False)
class ColourScale:
    """256 colours for values from `low` to `high`; others get the nearest colour."""

    low: float
    high: float
    colours: Picture

    @classmethod
    def grey(cls, values: Array, top: float | None = None) -> ColourScale:
        """Make a scale from black at 0 to white at `top`, by default the 99.5th percentile."""
        return cls(0.0, _limit(values) if top is None else top, GREYS)

    @classmethod
    def signed(cls, values: FloatMap) -> ColourScale:
        """Make a scale: blue, white at 0, red; ends at the 99.5th percentile of magnitudes."""
        top = _limit(np.abs(values))
        return cls(-top, top, _BLUE_WHITE_RED)

    @property
    def stops(self) -> Picture:
        """(3, 3) colours of a bar: both ends and the middle."""
        return self.colours[[0, len(self.colours) // 2, -1]]

    @property
    def ticks(self) -> tuple[float, float, float]:
        """The values of `stops`."""
        return self.low, (self.low + self.high) / 2.0, self.high

    def paint(self, values: Array) -> Picture:
        """Return a picture of (H, W) values, grey where they are NaN."""
        per_value = 255.0 / (self.high - self.low)
        levels = values.astype(np.float32)
        levels *= per_value
        levels += 0.5 - self.low * per_value
        invalid = np.isnan(levels)
        levels[invalid] = 0.0
        picture = coloured(np.clip(levels, 0.0, 255.0, out=levels).astype(np.uint8), self.colours)
        picture[invalid] = _INVALID_COLOUR
        return picture


def _limit(values: Array) -> float:
    """Return the 99.5th percentile; the maximum where it is 0, and 1 where that is 0 too."""
    values = values[~np.isnan(values)]
    if not values.size:
        return 1.0
    return float(np.percentile(values, _SCALE_PERCENT)) or float(values.max()) or 1.0


def coloured(levels: npt.NDArray[np.uint8], colours: Picture) -> Picture:
    """Return the picture of (H, W) indices into (256, 3) colours."""
    picture: Picture = cv2.applyColorMap(levels, colours[:, None, :]).astype(np.uint8, copy=False)
    return picture


def grey(image: Array, top: float | None = None) -> Picture:
    """Return a grey picture: black at 0, white at `top` or the 99.5th percentile."""
    return ColourScale.grey(image, top).paint(image)


def normal_map(normals: FloatMap) -> Picture:
    """Return (H, W, 3) unit normals as colours: (n + 1) / 2, y up, grey where they are NaN."""
    colours: Picture = np.rint((np.nan_to_num(normals) + 1.0) * 127.5).astype(np.uint8)
    colours[np.isnan(normals[..., 0])] = _INVALID_COLOUR
    return colours


def shaded(normals: FloatMap, contrast: float = 1.0) -> Picture:
    """Shade (H, W, 3) normals from the upper left, with a contrast about the grey of a plane."""
    return grey(_FLAT_GREY + contrast * (_shading(normals) - _FLAT_GREY), top=1.0)


def shading_contrast(normals: FloatMap, valid: BoolArray) -> float:
    """Return the contrast, 1 to 6, at which `shaded` uses all greys without cutting them off."""
    shading = _shading(normals[valid])
    if not shading.size:
        return 1.0
    darkest, brightest = np.percentile(shading, (100.0 - _SCALE_PERCENT, _SCALE_PERCENT))
    max_darkening = _FLAT_GREY / max(_FLAT_GREY - darkest, 1e-6)
    max_brightening = (1.0 - _FLAT_GREY) / max(brightest - _FLAT_GREY, 1e-6)
    return float(np.clip(min(max_darkening, max_brightening), 1.0, _MAX_CONTRAST))


def _shading(normals: FloatMap) -> FloatMap:
    """Shading without attached shadow: 0 facing away from the light, 1 facing it."""
    shading: FloatMap = 0.5 + 0.5 * (normals @ _RELIEF_LIGHT)
    return shading


def shadow_colours(lights: int) -> Picture:
    """Return the (256, 3) colours of the numbers of lights in shadow, one for each number."""
    last = len(_SHADOW_COLOURS) - 1
    positions = np.arange(256) * last / max(lights, last)
    channels = [np.interp(positions, range(last + 1), channel) for channel in _SHADOW_COLOURS.T]
    return np.stack(channels, axis=1).round().astype(np.uint8)


def dropped_colours(lights: int) -> Picture:
    """Return the (256, 3) colours of the values of `SurfaceEstimate.dropped`."""
    hues = np.zeros((256, 1, 3), dtype=np.uint8)
    lights = min(lights, NO_DROPPED_LIGHT)
    hues[:lights, 0] = [(180 * light // lights, 165, 215) for light in range(lights)]
    colours: Picture = cv2.cvtColor(hues, cv2.COLOR_HSV2RGB)[:, 0].astype(np.uint8)
    colours[NO_DROPPED_LIGHT] = _NO_LIGHT_COLOUR
    return colours


def light_images(
    captured: CapturedSet, count: int, longest_px: int = PICTURE_PX
) -> dict[str, Picture]:
    """Return pictures of the first light images, on one scale, by their titles."""
    images = [reduced(image, longest_px=longest_px) for image in captured.images[:count]]
    top = _limit(np.stack(images))
    tilts_deg = captured.lighting.tilts_deg
    part = f" of {len(tilts_deg)}" if len(tilts_deg) > count else ""
    return {
        f"light {index}{part}: tilt {tilts_deg[index]:.0f}": grey(image, top)
        for index, image in enumerate(images)
    }


def reduced(
    values: Array,
    interpolation: int = cv2.INTER_AREA,
    longest_px: int = PICTURE_PX,
) -> Array:
    """Reduce (H, W[, 3]) to a longer side of `longest_px`.

    Labels need INTER_NEAREST. Other values are means of those that are not NaN, or NaN where most
    are NaN.
    """
    if max(values.shape[:2]) <= longest_px:
        return values
    size = fitted_size(values.shape, longest_px)
    is_number = ~np.isnan(values)
    if is_number.all():
        return cv2.resize(values, size, interpolation=interpolation)
    share, summed = (
        cv2.resize(image.astype(np.float32), size, interpolation=interpolation)
        for image in (is_number, np.where(is_number, values, 0.0))
    )
    return np.where(share >= 0.5, summed / np.maximum(share, 0.5), np.float32(np.nan))


def fitted_size(shape: tuple[int, ...], longest_px: int) -> tuple[int, int]:
    """Width and height of an image of `shape` after its longer side became `longest_px`."""
    rows, columns = shape[:2]
    scale = longest_px / max(rows, columns)
    return max(1, round(columns * scale)), max(1, round(rows * scale))


def contact_sheet(pictures: dict[str, Picture]) -> Picture:
    """Return pictures of one size side by side, each below its name."""
    columns, tile_px, bar_px = 4, 320, 24
    tiles = []
    shape = next(iter(pictures.values())).shape
    size = fitted_size(shape, tile_px)
    interpolation = cv2.INTER_AREA if max(shape) > tile_px else cv2.INTER_NEAREST
    for name, picture in pictures.items():
        tile = np.full((size[1] + bar_px, tile_px, 3), 255, dtype=np.uint8)
        tile[bar_px:, : size[0]] = cv2.resize(picture, size, interpolation=interpolation)
        cv2.putText(tile, name, (4, 17), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (0, 0, 0), 1, cv2.LINE_AA)
        tiles.append(tile)
    while len(tiles) % columns:
        tiles.append(np.full_like(tiles[0], 255))
    rows = [np.hstack(tiles[i : i + columns]) for i in range(0, len(tiles), columns)]
    return np.vstack(rows)


def jpeg_bytes(picture: Picture) -> bytes:
    """Return the JPEG file of a picture."""
    options = [
        cv2.IMWRITE_JPEG_QUALITY, 85,
        # Without subsampling, thin lines keep their colours.
        cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444,
    ]  # fmt: skip
    _, buffer = cv2.imencode(".jpg", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR), options)
    return buffer.tobytes()


def png_bytes(picture: Picture) -> bytes:
    """Return the PNG file of a picture, or of an (H, W) grey image."""
    image = picture if picture.ndim == 2 else cv2.cvtColor(picture, cv2.COLOR_RGB2BGR)
    is_encoded, buffer = cv2.imencode(".png", image)
    if not is_encoded:
        raise ValueError(f"not a picture: {picture.shape} {picture.dtype}")
    return buffer.tobytes()


TILE_PX = 176  # longer side of a tile; six fit into a row of the page


def data_uri(picture: Picture) -> str:
    """Return a picture as the data URI of a JPEG."""
    return "data:image/jpeg;base64," + base64.b64encode(jpeg_bytes(picture)).decode("ascii")


def tile_uri(picture: Picture) -> str:
    """Return a picture at the size of a tile, as a data URI."""
    size = fitted_size(picture.shape, TILE_PX)
    return data_uri(cv2.resize(picture, size, interpolation=cv2.INTER_AREA).astype(np.uint8))
