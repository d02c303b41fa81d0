"""Links of the READMEs lead somewhere, their examples in Python run; CITATION.cff."""

import ast
import csv
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from contextlib import chdir
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import yaml

from capture import capture_set
from classify import TextureLibrary
from rig import RigConfig, open_rig

ROOT = Path(__file__).parent.parent
FOLDERS = [ROOT / name for name in ("capture", "classify", "firmware_sim", "rig", "tests")]
LINK = re.compile(r"!?\[[^\]]*\]\(([^()\s]+)\)")
HEADING = re.compile(r"^#{1,6} +(.*)$", re.MULTILINE)
CODE = re.compile(r"^```.*?^```", re.DOTALL | re.MULTILINE)
# Paths, and names of modules, in backquotes: those of the tables of where to change what.
PLACE = re.compile(r"`((?:capture|classify|firmware_sim|rig|tests)/[\w./-]*)`")
MODULE = re.compile(r"`(?:[\w/]*/)?(\w+\.py)`")


def pages() -> list[Path]:
    folders = (*FOLDERS, ROOT / "reference")
    return [ROOT / "README.md", *(path for each in folders for path in sorted(each.rglob("*.md")))]


@cache
def prose(page: Path) -> str:
    return CODE.sub("", page.read_text(encoding="utf-8"))


@cache
def anchors(page: Path) -> frozenset[str]:
    """Anchors of the headings, as GitHub makes them."""
    words = (re.sub(r"[^\w\- ]", "", heading).strip() for heading in HEADING.findall(prose(page)))
    return frozenset(each.lower().replace(" ", "-") for each in words)


@cache
def modules() -> frozenset[str]:
    return frozenset(path.name for each in FOLDERS for path in each.rglob("*.py"))


def broken(page: Path) -> Iterator[str]:
    """Links and places of a page that lead nowhere."""
    for link in LINK.findall(prose(page)):
        name, _, anchor = link.partition("#")
        target = page.parent / name if name else page
        if re.match(r"[a-z]+:", link):
            continue
        if not target.exists() or (anchor and anchor not in anchors(target)):
            yield link
    yield from (each for each in PLACE.findall(prose(page)) if not (ROOT / each).exists())
    yield from (each for each in MODULE.findall(prose(page)) if each not in modules())


def test_every_link_and_path_in_a_readme_leads_somewhere() -> None:
    found = [f"{page.relative_to(ROOT)}: {link}" for page in pages() for link in broken(page)]
    assert "\n".join(found) == ""


def test_the_readmes_are_read_whole() -> None:
    assert len(pages()) > 10
    assert "a-session" in anchors(ROOT / "capture" / "README.md")


EXAMPLE = re.compile(r"^```python\n(.*?)^```", re.DOTALL | re.MULTILINE)
# Those of the station need one; tests/capture/station has them.
EXAMPLES = {
    f"{page.relative_to(ROOT)}, {number}": example
    for page in (ROOT / "README.md", *(folder / "README.md" for folder in FOLDERS))
    for number, example in enumerate(EXAMPLE.findall(page.read_text(encoding="utf-8")), start=1)
}


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What the examples take for granted: names, and files of the folder `here`."""
    here = tmp_path_factory.mktemp("examples")
    config = RigConfig().with_changes(camera={"width_px": 256, "height_px": 256})
    with open_rig(config) as rig:
        captured = capture_set(rig, label="rock")
    captured.save(here / "rock.ome.tif")
    surface = captured.solve(planar=True)
    match = TextureLibrary.train([("rock", surface)]).classify(surface)
    goods = {"good_surfaces": [surface] * 3, "good_matches": [match] * 3}
    return {"here": here, "images": captured.images, "surface": surface, "match": match, **goods}


@pytest.mark.slow
@pytest.mark.parametrize("example", EXAMPLES)
def test_an_example_in_python_runs(example: str, given: dict[str, Any]) -> None:
    names = dict(given)
    with chdir(given["here"]):
        exec(compile(EXAMPLES[example], example, "exec"), names)


COMMANDS = re.compile(r"^```\n(.*?)^```", re.DOTALL | re.MULTILINE)


def commands_below(page: Path, heading: str) -> str:
    """The first commands below a heading."""
    section = page.read_text(encoding="utf-8").partition(f"\n## {heading}\n")[2]
    return COMMANDS.findall(section)[0]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("heading", "texture"),
    [("Photographs and their lights", "butterfly"), ("No hardware", "sand")],
)
def test_the_first_commands_classify_a_set(heading: str, texture: str, tmp_path: Path) -> None:
    (tmp_path / "tests").symlink_to(ROOT / "tests")
    commands = commands_below(ROOT / "README.md", heading)
    # The figures of the thesis have tests of their own.
    script = re.sub(r"^ps4rig reproduce.*\n", "", commands, flags=re.MULTILINE)
    script = re.sub(
        r"^(ps4rig classify \S+ --library \S+)", r"\1 --csv out.csv", script, flags=re.MULTILINE
    )
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", "-ec", script],
        cwd=tmp_path,
        env=os.environ | {"PATH": path},
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    with (tmp_path / "out.csv").open(newline="") as file:
        [row] = csv.DictReader(file)
    assert row["label"] == texture


def test_no_example_needs_a_development_package() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    installed = {re.split(r"[^\w-]", each)[0] for each in project["dependencies"]}
    allowed = installed | {each.name for each in FOLDERS} | sys.stdlib_module_names
    examples = [each for page in pages() for each in EXAMPLE.findall(page.read_text("utf-8"))]
    nodes = [node for each in examples for node in ast.walk(ast.parse(each))]
    names = {each.name for node in nodes if isinstance(node, ast.Import) for each in node.names}
    names |= {str(node.module) for node in nodes if isinstance(node, ast.ImportFrom)}
    assert {each.partition(".")[0] for each in names} <= allowed


def test_the_citation_is_that_of_the_package() -> None:
    """The keys that CFF 1.2.0 requires, and what pyproject.toml says too."""
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert (citation["cff-version"], citation["type"]) == ("1.2.0", "software")
    assert {"message", "authors"} <= set(citation)
    same = (project["name"], project["version"], project["license"])
    assert (citation["title"], citation["version"], citation["license"]) == same
    [thesis] = citation["references"]
    assert (thesis["type"], thesis["year"]) == ("thesis", 2003)
    assert thesis["authors"] == [{"family-names": "Wu", "given-names": "Jiahua"}]
