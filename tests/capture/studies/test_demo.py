"""`ps4rig demo`: a smoke test of the program from capture to report."""

import re
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

from capture import CapturedSet
from classify import TextureLibrary
from rig import surface_names


class _Links(HTMLParser):
    """What a page loads or points to, and its rows."""

    def __init__(self) -> None:
        super().__init__()
        self.targets: list[str] = []
        self.ids: set[str] = set()
        self.rows: list[str | None] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if name in ("src", "href", "action", "data", "poster", "srcset"):
                self.targets.append(value or "")
            elif name == "id":
                self.ids.add(value or "")
        if tag == "tr":
            self.rows.append(dict(attrs).get("class"))


@pytest.mark.slow
def test_the_demo_captures_trains_classifies_and_reports(
    ps4rig: Callable[..., Any], tmp_path: Path
) -> None:
    output = tmp_path / "demo"
    result = ps4rig("demo", "--out", output)
    assert result.exit_code == 0, result.stderr
    assert result.stdout.startswith("Simulated rig: no light, camera or part of this demo is real.")
    right, total = map(int, re.findall(r"(\d+) of (\d+) right\. Simulated rig\.", result.stdout)[0])
    assert total == 24
    assert right >= 23

    names = surface_names()
    assert len(names) == 12
    sets = sorted(path.name for path in (output / "sets").iterdir())
    assert len(sets) == 36
    assert sum(name.startswith("train") for name in sets) == 12
    first = CapturedSet.load(output / "sets" / sets[0])
    assert first.metadata.simulated
    assert first.solve().valid.mean() > 0.9
    assert set(TextureLibrary.load(output / "textures.ps4lib").labels) == set(names)

    page = (output / "report.html").read_text(encoding="utf-8")
    links = _Links()
    links.feed(page)
    assert "imulated rig" in page
    assert sum(kind in ("right", "wrong") for kind in links.rows) == 24
    assert links.rows.count("right") == right
    outside = [target for target in links.targets if not target.startswith(("#", "data:"))]
    assert outside == []
    assert {target[1:] for target in links.targets if target.startswith("#")} <= links.ids
    assert not re.search(r"@import|url\(\s*['\"]?(?!#|data:)", page)
    assert sum(target.startswith("data:image/") for target in links.targets) >= 24 * 8
    assert {path.name for path in output.iterdir()} == {"sets", "textures.ps4lib", "report.html"}


def test_a_file_instead_of_the_output_folder_is_named(
    refused: Callable[..., str], tmp_path: Path
) -> None:
    (tmp_path / "file").touch()
    assert "file: cannot be made" in refused("demo", "--out", tmp_path / "file")
