"""Pictures as addresses in an HTML page."""

import base64

import cv2
import numpy as np

from capture.base.page import image_html

from .pictures import Picture, jpeg_bytes

TILE_PX = 176  # longer side of a tile; six fit into a row of the page


def data_uri(picture: Picture) -> str:
    """Return a picture as a JPEG in the text of an address."""
    return "data:image/jpeg;base64," + base64.b64encode(jpeg_bytes(picture)).decode("ascii")


def tile_uri(picture: Picture) -> str:
    """Return a picture at the size of a tile, as the text of an address."""
    scale = TILE_PX / max(picture.shape[:2])
    size = [max(1, round(scale * side)) for side in picture.shape[1::-1]]
    return data_uri(cv2.resize(picture, size, interpolation=cv2.INTER_AREA).astype(np.uint8))


def tile_html(name: str, picture: Picture) -> str:
    """Return a picture as a small figure with its name below it."""
    return image_html(tile_uri(picture), name, name)
