"""What people who cannot see well, or use no mouse, need of a page; with axe-core."""

import json
from importlib.resources import files

from .chromium import Page

_GRAVE = ("serious", "critical")
# What Tab reaches: of radio buttons of one name, one.
_REACHABLE = """
[...document.querySelectorAll(
    'a[href], button, input:not([type=hidden]), select, textarea, summary, [tabindex="0"]')]
  .filter((each) => !each.disabled && each.checkVisibility({visibilityProperty: true}))
"""
_WATCH = """
window.reached = new Set([document.activeElement]); window.unmarked = [];
document.addEventListener('focusin', ({target}) => {
  reached.add(target.type == 'radio' ? `radio ${target.name}` : target);
  const style = getComputedStyle(target);
  if (style.outlineStyle == 'none' || !parseFloat(style.outlineWidth))
    unmarked.push(target.outerHTML.slice(0, 200));
}); 1
"""
_MISSED = f"""
{_REACHABLE}
  .filter((each) => !reached.has(each.type == 'radio' ? `radio ${{each.name}}` : each))
  .map((each) => each.outerHTML.slice(0, 200))
"""
# A field for a time has seven stops of Tab.
_STOPS = 8


def grave_findings(page: Page) -> list[str]:
    """What axe-core finds of serious or critical impact on a page, with the elements."""
    axe = files("axe_core_python").joinpath("axe.min.js").read_text(encoding="utf-8")
    page.value(f"{axe}; 1")
    found = page.value(
        "axe.run({resultTypes: ['violations']}).then((found) => JSON.stringify("
        "found.violations.map(({id, impact, nodes}) => "
        "[impact, `${id}: ${nodes.map((node) => node.html.slice(0, 200)).join(' | ')}`])))"
    )
    return [text for impact, text in json.loads(found) if impact in _GRAVE]


def missed_by_tab(page: Page) -> list[str]:
    """Elements that the Tab key does not reach, or that do not show that they have the focus."""
    page.value(_WATCH)
    for _ in range(_STOPS * page.value(f"{_REACHABLE}.length")):
        page.press("Tab")
        if not page.value(f"{_MISSED}.length"):
            break
    return list(page.value(_MISSED)) + list(page.value("unmarked"))
