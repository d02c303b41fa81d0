"""The page of a part: as text, and in Chromium."""

import re
import threading
from dataclasses import dataclass, replace

import pytest

from capture.station.domain.users import Role
from capture.station.domain.verdict import Cause, Decision, Verdict
from capture.station.panel import part_pictures
from capture.station.panel.part_pictures import PaintedPicture, painted
from capture.station.panel.part_view import PartView
from capture.station.results.part_result import DefectRecord, PartResult
from capture.station.results.removals import record_removals
from tests.accessibility import grave_findings
from tests.capture.station.panel.panels import PASSWORD, Client, RunningPanel
from tests.chromium import Chromium, Page

SCRATCH = DefectRecord("relief", 4, 6, 8, 16, 128, 3.1)
STAIN = DefectRecord("albedo", 20, 2, 8, 8, 64, 1.4)
BAD = Verdict(Decision.FAIL, "defect score 3.10, at most 1.00", (Cause.DEFECT,))
SHOWN = "window.pictures && !pictures.classList.contains('without')"


@dataclass(frozen=True)
class Scratched:
    """What the inspector says of a part with two defects."""

    verdict: Verdict = BAD
    defects: tuple[DefectRecord, ...] = (SCRATCH, STAIN)

    def recorded(self, part: PartResult) -> PartResult:
        return replace(
            part,
            verdict=self.verdict,
            nearest="rock",
            distance=1.25,
            limit=1.0,
            defect_score=3.1,
            defects=self.defects,
        )


@pytest.fixture
def scratched(panel: RunningPanel) -> RunningPanel:
    """A panel whose parts have two defects each."""
    panel.bench.inspector.inspect = lambda _: Scratched()
    return panel


def text_of(client: Client, path: str) -> str:
    answer = client.get(path)
    assert answer.status == 200
    return " ".join(re.sub("<[^>]*>", " ", answer.text).split())


def test_a_part_is_shown_with_its_numbers_against_the_limits(scratched: RunningPanel) -> None:
    first, part_id, last = scratched.parts(3)
    text = text_of(scratched.local, f"/parts/{part_id}")
    assert f"FAIL {part_id} defect score 3.10, at most 1.00 Causes: defect" in text
    assert "distance to rock 1.25 at most 1.00 no" in text
    assert "The limits are not known: the part was judged by no recipe." in text
    assert "relief, score 3.10 128 px at column 6, row 4" in text
    result = next(iter(scratched.bench.store.parts())).result
    assert result.set_sha256 is not None
    assert result.set_sha256 in text
    assert "operator Ada" in text
    page = scratched.local.get(f"/parts/{part_id}").text
    assert f'rel="prev" href="/parts/{first}"' in page
    assert f'rel="next" href="/parts/{last}"' in page
    assert 'rel="next"' not in scratched.local.get(f"/parts/{last}").text
    assert 'rel="prev"' not in scratched.local.get(f"/parts/{first}").text
    assert scratched.local.get("/parts/nobody").status == 404


def test_an_engineer_overrides_the_verdict_on_the_page(scratched: RunningPanel) -> None:
    (part_id,) = scratched.parts(1)
    scratched.panel.users.put("eve", Role.ENGINEER, PASSWORD)
    scratched.panel.users.put("olga", Role.OPERATOR, PASSWORD)
    eve, olga = scratched.local, scratched.local
    eve.log_in("eve")
    olga.log_in("olga")
    path = f"/parts/{part_id}/override"
    assert "Engineers may override" in text_of(olga, f"/parts/{part_id}")
    assert olga.form(path, decision="PASS", reason="dust").status == 403
    empty = eve.form(path, decision="PASS", reason=" ")
    assert empty.status == 400
    assert "reason: must not be empty" in empty.text
    assert eve.form(path, decision="PASS", reason="<b>dust</b>").status == 303
    page = eve.get(f"/parts/{part_id}").text
    assert "&lt;b&gt;dust&lt;/b&gt;" in page
    text = text_of(eve, f"/parts/{part_id}")
    assert f"PASS {part_id} eve on " in text
    assert "The station said FAIL: defect score 3.10" in text


def lit(page: Page) -> int:
    """A number that differs when the relit view does."""
    return int(
        page.value(
            "relit.getContext('2d').getImageData(0, 0, relit.width, relit.height).data"
            ".reduce((sum, level, at) => (sum * 31 + level * (at + 1)) % 1000003, 7)"
        )
    )


def moved(page: Page, across: float, down: float) -> None:
    """Move the mouse to a point of the relit view, given as shares of its sides."""
    page.value("relit.scrollIntoView({block: 'center'}); 1")
    box = page.value("(({x, y, width, height}) => [x, y, width, height])"
                     "(relit.getBoundingClientRect())")  # fmt: skip
    x, y = box[0] + across * box[2], box[1] + down * box[3]
    page.call("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)


@pytest.mark.browser
def test_the_light_of_the_relit_view_follows_mouse_and_keys(
    scratched: RunningPanel, browser: Chromium
) -> None:
    (part_id,) = scratched.parts(1)
    page = browser.page(f"{scratched.url}parts/{part_id}")
    page.until(f"{SHOWN} && light.textContent.includes('tilt 135')")
    seen = {lit(page)}
    for across, down, said in (
        (0.95, 0.5, "tilt 0°, slant 72°"),
        (0.5, 0.05, "tilt 90°, slant 72°"),
        (0.25, 0.5, "tilt 180°, slant 40°"),
    ):
        moved(page, across, down)
        page.until(f"light.textContent.endsWith('{said}')")
        seen.add(lit(page))
    page.value("relit.focus(); 1")
    page.press("ArrowLeft")
    page.until("light.textContent.endsWith('tilt 185°, slant 40°')")
    page.press("ArrowDown")
    page.until("light.textContent.endsWith('tilt 185°, slant 45°')")
    seen.add(lit(page))
    page.value("grey.click(); 1")
    page.until("grey.checked")
    page.value("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    seen.add(lit(page))
    assert len(seen) == 6
    assert page.errors() == []


@pytest.mark.browser
def test_three_presses_lead_from_the_verdict_to_the_defect(
    scratched: RunningPanel, browser: Chromium
) -> None:
    (part_id,) = scratched.parts(1)
    page = browser.page(scratched.url)
    page.until(f"part.textContent == '{part_id}'")
    page.value("part.click(); 1")
    page.until(f"location.pathname == '/parts/{part_id}' && {SHOWN}")
    assert "defect score 3.10, at most 1.00" in page.value("document.body.innerText")
    page.value("document.querySelectorAll('#defects button')[1].click(); 1")
    outline = page.value("document.querySelector('#outlines .line').getAttribute('points')")
    assert outline == "2.5,20.5 9.5,20.5 9.5,27.5 2.5,27.5"
    shown = page.value("document.querySelector('#outlines .line').getBoundingClientRect().width")
    whole = page.value("stage.getBoundingClientRect().width")
    assert shown == pytest.approx(7 / 32 * whole, abs=1.0)
    page.value("[...views.children].find((each) => each.dataset.view == 'defects').click(); 1")
    page.until("!shown.hidden && shown.complete && shown.naturalWidth == 32 && relit.hidden")
    assert grave_findings(page) == []
    assert page.errors() == []


@pytest.mark.browser
def test_a_long_list_of_defects_is_not_cut_on_a_telephone(
    panel: RunningPanel, browser: Chromium
) -> None:
    panel.bench.inspector.inspect = lambda _: Scratched(defects=12 * (SCRATCH,))
    (part_id,) = panel.parts(1)
    page = browser.page(f"{panel.url}parts/{part_id}")
    page.show(390, 844)
    page.until(SHOWN)
    assert page.value("defects.scrollHeight <= defects.clientHeight")
    assert page.value("views.offsetTop < defects.offsetTop")
    page.show(1280, 800)
    assert page.value("defects.scrollHeight > defects.clientHeight")


@pytest.mark.browser
def test_a_part_whose_set_was_removed_keeps_its_numbers_and_says_so(
    scratched: RunningPanel, browser: Chromium
) -> None:
    (part_id,) = scratched.parts(1)
    result = next(iter(scratched.bench.store.parts())).result
    assert result.set_file is not None
    record_removals(scratched.bench.store, {part_id: result.set_file}, result.decided_utc)
    (scratched.bench.folder.path / result.set_file).unlink()
    page = browser.page(f"{scratched.url}parts/{part_id}")
    page.until("document.getElementById('no-pictures').textContent.startsWith('No pictures:')")
    text = page.value("document.querySelector('main').innerText")
    assert "its set file was removed by the retention on" in text
    assert "relief, score 3.10" in text
    assert "Slopes" not in text


@pytest.mark.browser
def test_a_picture_that_cannot_come_is_asked_for_once_more_and_given_up(
    panel: RunningPanel, browser: Chromium
) -> None:
    page = browser.page(panel.url)
    page.value(
        """(async () => {
  const { retrying } = await import("/static/requests.js");
  window.failed = 0;
  const image = retrying(new Image());
  image.addEventListener("error", () => { window.failed += 1; });
  image.src = "/api/v1/parts/nobody/pictures/albedo";
})()"""
    )
    page.until(
        "performance.getEntriesByType('resource').some((each) => each.initiatorType === 'fetch' "
        "&& each.name.endsWith('/nobody/pictures/albedo'))"
    )
    # A second later it would be asked for again.
    page.value("new Promise((resolve) => { setTimeout(resolve, 2500); })")
    assert page.value("window.failed") == 1


def without_shadow(view: PartView, size: str) -> dict[str, PaintedPicture]:
    pictures = painted(view, size)
    del pictures["shadow"]
    return pictures


@pytest.mark.browser
def test_pictures_of_an_earlier_part_are_blanked_with_their_age(
    scratched: RunningPanel, browser: Chromium, monkeypatch: pytest.MonkeyPatch
) -> None:
    scratched.until_ready()
    page = browser.page(scratched.url)
    (part_id,) = scratched.parts(1)
    fresh = "document.querySelectorAll('.picture:not(.blank) img').length"
    page.until(f"{fresh} >= 8")
    page.until("rejected.querySelector('img.thumbnail').naturalWidth == 32")
    assert grave_findings(page) == []
    judging = threading.Event()
    scratched.bench.inspector.inspect = lambda _: judging.wait(60) and Scratched()
    scratched.until_ready()
    assert scratched.local.post("/api/v1/trigger").status == 202
    page.until(f"{fresh} == 0")
    assert page.value("getComputedStyle(document.querySelector('.picture img')).visibility") == (
        "hidden"
    )
    told = page.value("document.querySelector('.picture .age').textContent")
    assert re.fullmatch(f"picture of {part_id}, \\d+ (s|min) old", told)
    # The second part has no picture of its shadows, and that of the first is no stand-in.
    monkeypatch.setattr(part_pictures, "painted", without_shadow)
    judging.set()
    page.until(f"{fresh} >= 7")
    named = page.value(
        "[...document.querySelectorAll('.picture')].map((each) => each.dataset.name)"
    )
    assert sorted(named) == [
        "albedo", "defects", "light-0", "light-1", "light-2", "light-3", "relief",
    ]  # fmt: skip
    # A part without a set has no pictures; those of the part before stay blanked.
    scratched.bench.camera.on_capture = lambda _: (_ for _ in ()).throw(OSError("unplugged"))
    scratched.until_ready()
    assert scratched.local.post("/api/v1/trigger").status == 202
    page.until(
        "document.querySelector('.picture .age').textContent.includes('no set was captured')"
    )
    assert page.value(fresh) == 0
    assert page.errors() == []
