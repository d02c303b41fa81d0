"""Pictures of every page of the panel, of a station on the simulated rig.

``python -m tests.capture.station.panel.screens OUT`` makes those of its README;
``--dark`` and ``--size 1024x768`` show them in a dark room and on a tablet.
"""

import argparse
import re
import tempfile
from pathlib import Path

from tests.capture.station.panel.demonstration import demonstration
from tests.capture.station.panel.pages import PAGES, REPORTS, address_of, logged_in
from tests.capture.station.panel.panels import ServedPanel
from tests.chromium import chromium

_TALLEST_PX = 1200
# All pictures together have less than 600 kB.
_SCALE = 0.55
_HAS_PICTURES = """
!document.body.innerText.includes('are being made')
&& [...document.images].every((image) => image.complete)
"""
# The operator's page gets its parts and pictures one after the other.
_IS_FILLED = {
    "/": "pictures.querySelector('img') && rejected.querySelector('img') "
    "&& !rejected.querySelector('img[hidden]')"
}


def name_of(path: str) -> str:
    """The file of a page without its suffix: ``recipe-settings`` for that of one recipe."""
    words = re.sub(r"s/{\w+}", "", path).strip("/").replace("/", "-")
    return words or "operator"


def make(
    out: Path, served: ServedPanel, size: tuple[int, int], profile: Path, *, dark: bool
) -> None:
    """Keep a picture of each page, down to `_TALLEST_PX`, when its own pictures are there."""
    width, height = size
    with chromium(profile) as browser:
        page = logged_in(browser, served)
        for route in (*PAGES, *REPORTS):
            page.show(width, height, dark=dark)
            page.go(address_of(route, served))
            page.until(f"!!({_IS_FILLED.get(route.path, 'true')})")
            page.until(_HAS_PICTURES)
            tall = page.value("document.documentElement.scrollHeight")
            page.show(width, max(height, min(tall, _TALLEST_PX)), dark=dark)
            page.until(_HAS_PICTURES)
            page.picture(out / f"{name_of(route.path)}.jpg", scale=_SCALE)
            assert page.errors() == []


def main() -> None:
    """Make the station, its parts, and the pictures."""
    parser = argparse.ArgumentParser(description="Pictures of every page of the panel")
    parser.add_argument("out", type=Path)
    parser.add_argument("--parts", type=int, default=130)
    parser.add_argument("--side", type=int, default=512, help="of the images, in pixels")
    parser.add_argument("--size", default="1280x800")
    parser.add_argument("--dark", action="store_true")
    given = parser.parse_args()
    width, height = map(int, given.size.split("x"))
    given.out.mkdir(parents=True, exist_ok=True)
    with (
        tempfile.TemporaryDirectory() as folder,
        demonstration(Path(folder) / "line-1", given.parts, given.side) as served,
    ):
        make(given.out, served, (width, height), Path(folder) / "profile", dark=given.dark)


if __name__ == "__main__":
    main()
