"""An HTML page, read as a browser reads it."""

import re
from html.parser import HTMLParser
from pathlib import Path

VOID = {"meta", "img", "br"}


class Page(HTMLParser):
    """The elements with their attributes, and the text of a page."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self.open: list[str] = []
        self.feed(html)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if "style" not in self.open and data.strip():
            self.text += data

    def all(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.elements if name == tag]


_LINK = re.compile(r"""\b(?:src|href|action|data|poster|srcset)\s*=\s*["']?([^"'>\s]*)""")


def self_contained(path: Path) -> str:
    """HTML of a page, its embedded images cut to ``data:TYPE``; it must load nothing else."""
    html = re.sub(r"(data:[\w/+-]*)[^\"']*", r"\1", path.read_text(encoding="utf-8"))
    targets = _LINK.findall(html)
    assert [target for target in targets if not target.startswith(("#", "data:"))] == []
    anchors = {target[1:] for target in targets if target.startswith("#")}
    assert anchors <= set(re.findall(r'\bid="([^"]*)"', html))
    assert not re.search(r"@import|url\(\s*['\"]?(?!#|data:)", html)
    return html
