"""Links of the READMEs: files that exist, and headings that they have."""

import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parent.parent
FOLDERS = [ROOT / name for name in ("capture", "classify", "firmware_sim", "rig", "tests")]
LINK = re.compile(r"!?\[[^\]]*\]\(([^()\s]+)\)")
HEADING = re.compile(r"^#{1,6} +(.*)$", re.MULTILINE)
CODE = re.compile(r"^```.*?^```", re.DOTALL | re.MULTILINE)
# Paths, and names of modules, in backquotes: those of the tables of where to change what.
PLACE = re.compile(r"`((?:capture|classify|firmware_sim|rig|tests)/[\w./-]*)`")
MODULE = re.compile(r"`(?:[\w/]*/)?(\w+\.py)`")


def pages() -> list[Path]:
    return [ROOT / "README.md", *(path for each in FOLDERS for path in sorted(each.rglob("*.md")))]


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
