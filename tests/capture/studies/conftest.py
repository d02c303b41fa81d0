"""A check of the HTML pages that studies write."""

import re
from collections.abc import Callable
from pathlib import Path

import pytest

_LINK = re.compile(r"""\b(?:src|href|action|data|poster|srcset)\s*=\s*["']?([^"'>\s]*)""")


def _self_contained(path: Path) -> str:
    """HTML of a page, its embedded images cut to ``data:TYPE``; it must load nothing else."""
    html = re.sub(r"(data:[\w/+-]*)[^\"']*", r"\1", path.read_text(encoding="utf-8"))
    targets = _LINK.findall(html)
    assert [target for target in targets if not target.startswith(("#", "data:"))] == []
    anchors = {target[1:] for target in targets if target.startswith("#")}
    assert anchors <= set(re.findall(r'\bid="([^"]*)"', html))
    assert not re.search(r"@import|url\(\s*['\"]?(?!#|data:)", html)
    return html


@pytest.fixture(scope="session")
def self_contained() -> Callable[[Path], str]:
    return _self_contained
