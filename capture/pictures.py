"""Maps as pictures for people: 8-bit RGB arrays, PNG bytes."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from classify import Lighting, SurfaceEstimate, integrate_gradients

from .captured_set import CapturedSet

__all__ = [
    "contact_sheet",
    "grey",
    "light_pictures",
    "normal_map",
    "png_bytes",
    "relief",
    "shadow_map",
    "signed",
    "surface_pictures",
]

Picture = npt.NDArray[np.uint8]
_SHOWN_LIGHTS = 4
_SHADOW_COLOURS = np.array(
    [[235, 235, 235], [250, 190, 80], [225, 105, 40], [150, 35, 45], [40, 10, 40]], dtype=np.uint8
)


def grey(image: npt.NDArray[Any], top: float | None = None) -> Picture:
    """(H, W) as grey, black at 0 and white at `top` (the 99.5th percentile if None)."""
    white = float(np.percentile(image, 99.5)) if top is None else top
    levels = np.clip(image.astype(np.float32) * np.float32(255.0 / max(white, 1e-12)), 0, 255)
    return np.repeat(levels.astype(np.uint8)[:, :, None], 3, axis=2)


def signed(values: npt.NDArray[np.float32]) -> Picture:
    """(H, W) with zero white, positive red, negative blue."""
    top = max(float(np.percentile(np.abs(values), 99.5)), 1e-12)
    strength = np.clip(values / top, -1.0, 1.0)[:, :, None]
    red = np.array([178, 24, 43], dtype=np.float32)
    blue = np.array([33, 102, 172], dtype=np.float32)
    full = np.where(strength > 0, red, blue)
    colours: Picture = (247.0 + np.abs(strength) * (full - 247.0)).astype(np.uint8)
    return colours


def normal_map(normals: npt.NDArray[np.float32]) -> Picture:
    """(H, W, 3) unit normals in the usual colours, (n + 1) / 2, y up."""
    colours: Picture = np.rint((normals + 1.0) * 127.5).astype(np.uint8)
    return colours


def relief(surface: SurfaceEstimate) -> Picture:
    """The relief without its albedo, lit from the upper left."""
    light = Lighting.from_angles([135.0], 55.0).directions[0].astype(np.float32)
    # From 0 facing away to 1 facing the light: steep slopes keep their shape in the dark.
    return grey(0.5 + 0.5 * (surface.normals @ light), top=1.0)


def shadow_map(surface: SurfaceEstimate) -> Picture:
    """Number of lights in shadow: light grey 0, then yellow to black for 1 to 4 and more."""
    return _SHADOW_COLOURS[np.minimum(surface.shadow_count, len(_SHADOW_COLOURS) - 1)]


def light_pictures(captured: CapturedSet) -> dict[str, Picture]:
    """The images under the first four lights on one scale, by tilt."""
    top = float(np.percentile(captured.images[:_SHOWN_LIGHTS], 99.5))
    return {
        f"light {index}: tilt {captured.lighting.tilts_deg[index]:.0f}": grey(image, top)
        for index, image in enumerate(captured.images[:_SHOWN_LIGHTS])
    }


def surface_pictures(surface: SurfaceEstimate) -> dict[str, Picture]:
    """The maps of a surface, by name."""
    height = integrate_gradients(surface.p, surface.q)
    return {
        "albedo": grey(surface.albedo),
        "relief": relief(surface),
        "normals": normal_map(surface.normals),
        "p = dz/dx": signed(surface.p),
        "q = dz/dy": signed(surface.q),
        "height (relative)": signed(height),
        "lights in shadow": shadow_map(surface),
        "residual": grey(surface.residual),
    }


def contact_sheet(pictures: dict[str, Picture]) -> Picture:
    """Pictures of one size side by side, each under its name."""
    columns, tile_px, bar_px = 4, 320, 24
    tiles = []
    rows_px, columns_px = next(iter(pictures.values())).shape[:2]
    scale = tile_px / max(rows_px, columns_px)
    size = (max(1, round(columns_px * scale)), max(1, round(rows_px * scale)))
    for name, picture in pictures.items():
        smaller = cv2.INTER_AREA if scale < 1 else cv2.INTER_NEAREST
        tile = np.full((size[1] + bar_px, tile_px, 3), 255, dtype=np.uint8)
        tile[bar_px : bar_px + size[1], : size[0]] = cv2.resize(
            picture, size, interpolation=smaller
        )
        cv2.putText(tile, name, (4, 17), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (0, 0, 0), 1, cv2.LINE_AA)
        tiles.append(tile)
    while len(tiles) % columns:
        tiles.append(np.full_like(tiles[0], 255))
    rows = [np.hstack(tiles[i : i + columns]) for i in range(0, len(tiles), columns)]
    return np.vstack(rows)


def png_bytes(picture: Picture) -> bytes:
    """RGB picture as a PNG file."""
    done, buffer = cv2.imencode(".png", np.ascontiguousarray(picture[:, :, ::-1]))
    if not done:  # only for an array that is no picture
        raise ValueError(f"not a picture: {picture.shape} {picture.dtype}")
    return buffer.tobytes()
