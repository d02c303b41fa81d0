"""`ps4rig demo`: a smoke test of the program from capture to report."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from capture import CapturedSet
from classify import TextureLibrary
from rig import surface_names
from tests.html_page import self_contained


@pytest.mark.slow
def test_the_demo_captures_trains_classifies_and_reports(
    ps4rig: Callable[..., Any], tmp_path: Path
) -> None:
    output = tmp_path / "demo"
    result = ps4rig("demo", "--out", output)
    assert result.exit_code == 0, result.stderr
    assert result.stdout.startswith("Simulated rig: ")
    right, total = map(int, re.findall(r"(\d+) of (\d+) right\. Simulated rig\.", result.stdout)[0])
    assert total == 24
    assert right >= 23

    # The angle of a texture with a weak direction is marked.
    for name, is_marked in (("concrete_wall_005", True), ("malv", True), ("Bark014", False)):
        rows = re.findall(rf"{name} +{name} +\S+ +(\S+( \?)?) ", result.stdout)
        assert [bool(mark) for _, mark in rows] == [is_marked, is_marked]

    names = surface_names()
    assert len(names) == 12
    sets = sorted(path.name for path in (output / "sets").iterdir())
    assert len(sets) == 36
    assert sum(name.startswith("train") for name in sets) == 12
    first = CapturedSet.load(output / "sets" / sets[0])
    assert first.metadata.simulated
    assert first.solve().valid.mean() > 0.9
    assert set(TextureLibrary.load(output / "textures.ps4lib").labels) == set(names)

    page = self_contained(output / "report.html")
    assert "imulated rig" in page
    assert len(re.findall(r'<tr class="(?:right|wrong)"', page)) == 24
    assert page.count('<tr class="right"') == right
    marked = len(re.findall(r"<td>\d+\.\d \?</td>", page))
    assert 4 <= marked == len(re.findall(r"</b> at \d+\.\d° \?\.", page))
    assert page.count('"data:image/') >= 24 * 8
    assert {path.name for path in output.iterdir()} == {"sets", "textures.ps4lib", "report.html"}


@pytest.mark.parametrize("name", ["textures.ps4lib", "sets/train-00-{}.ome.tif"])
def test_the_demo_replaces_no_set_and_no_library(
    refused: Callable[..., str], tmp_path: Path, name: str
) -> None:
    existing = tmp_path / name.format(surface_names()[0])
    existing.parent.mkdir(exist_ok=True)
    existing.write_text("mine")
    assert f"{existing}: exists already" in refused("demo", "--out", tmp_path)
    assert existing.read_text() == "mine"
