"""Maps as figures of an HTML page: picture, legend, caption."""

import base64
from collections.abc import Sequence
from html import escape

import cv2
import numpy as np

from capture.page.skeleton import image_html

from .pictures import ColourScale, Picture, jpeg_bytes
from .views import MapView

# A smaller picture is enlarged on the page, with square pixels instead of interpolation.
_SMALL_PX = 256
TILE_PX = 176  # longer side of a tile; six fit into a row of the page


def figure_html(view: MapView) -> str:
    """Return the figure of a map with its colours; all text is escaped."""
    rows, columns = view.picture.shape[:2]
    small = ' class="small"' if max(rows, columns) < _SMALL_PX else ""
    legend = _bar(view.scale) if view.scale else _swatches(view.legend)
    unit = f", {escape(view.unit)}" if view.unit else ""
    file = f" <code>{escape(view.file)}</code>" if view.file else ""
    return (
        f'<figure><img{small} alt="{escape(view.title)}" src="{data_uri(view.picture)}">{legend}'
        f"<figcaption><b>{escape(view.title)}</b>{unit}{file}<br>{escape(view.caption)}</figcaption>"
        "</figure>"
    )


def tile_html(name: str, picture: Picture) -> str:
    """Return a picture as a small figure with its name below it."""
    scale = TILE_PX / max(picture.shape[:2])
    size = [max(1, round(scale * side)) for side in picture.shape[1::-1]]
    small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False)
    return image_html(data_uri(small), name, name)


def _bar(scale: ColourScale) -> str:
    """Return a colour bar, with the values at both ends and in the middle."""
    low, middle, high = (scale.colours[i] for i in (0, len(scale.colours) // 2, -1))
    colours = ", ".join(f"rgb({r},{g},{b})" for r, g, b in (low, middle, high))
    values = (scale.low, (scale.low + scale.high) / 2.0, scale.high)
    ticks = "".join(f"<span>{number_text(value)}</span>" for value in values)
    return (
        f'<div class="bar" style="background:linear-gradient(to right, {colours})"></div>'
        f'<div class="ticks">{ticks}</div>'
    )


def _swatches(legend: tuple[tuple[Sequence[int], str], ...]) -> str:
    entries = "".join(
        f'<span><i style="background:rgb({r},{g},{b})"></i>{escape(name)}</span>'
        for (r, g, b), name in legend
    )
    return f'<div class="legend">{entries}</div>' if entries else ""


def number_text(value: float) -> str:
    """Return three digits of a number, with a minus sign."""
    return f"{value:.3g}".replace("-", "\N{MINUS SIGN}")


def data_uri(picture: Picture) -> str:
    """Return a picture as a JPEG in the text of an address."""
    return "data:image/jpeg;base64," + base64.b64encode(jpeg_bytes(picture)).decode("ascii")
