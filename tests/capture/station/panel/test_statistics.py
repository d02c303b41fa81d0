"""History and statistics: the page, the API, CSV, PNG and `station history` agree."""

import csv
import http.client
import io
import json
import re
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from html import unescape
from typing import Any
from urllib.parse import parse_qsl

import cv2
import numpy as np
import pytest
from matplotlib.figure import Figure

from capture.sets.captured_set import CapturedSet
from capture.station.domain.verdict import Decision
from capture.station.judge.gauge import GaugeReport, Presentation
from capture.station.panel import charts
from capture.station.panel.panel import MAX_RECKONING
from capture.station.panel.statistics import gauge_of
from capture.station.results.history import Selection
from classify.base.errors import InputError
from tests.capture.station.panel.panels import WAIT_S, RunningPanel, running_panel
from tests.capture.station.results.many import fill, many

PRODUCED, SIMULATED = 400, 60


@pytest.fixture(scope="module")
def filled(
    tmp_path_factory: pytest.TempPathFactory, captured: CapturedSet
) -> Iterator[RunningPanel]:
    """A panel with results of production and of a simulated rig, two of them overridden."""
    with running_panel(tmp_path_factory.mktemp("filled") / "line-1", captured) as running:
        running.until_ready()
        store, parts = running.bench.store, many("line-1", PRODUCED, simulated=SIMULATED)
        fill(store, parts)
        for each in [each for each in parts if each.verdict.decision is Decision.FAIL][:2]:
            store.override(
                each.part_id, decision=Decision.PASS, by="Kim", reason="a <hair>",
                utc=each.decided_utc,
            )  # fmt: skip
        yield running


def rows_of(page: str) -> list[str]:
    """The texts of the rows of the table of parts."""
    body = page.partition("<tbody>")[2].partition("</tbody>")[0]
    rows = (unescape(re.sub("<[^>]*>", " ", row)) for row in body.split("</tr>"))
    return [" ".join(row.split()) for row in rows if row.strip()]


def numbers_of(page: str) -> list[int]:
    return [int(row.partition(" ")[0]) for row in rows_of(page)]


def table_of(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(text)))


def statistics_of(panel: RunningPanel, query: str = "") -> dict[str, Any]:
    answer = panel.local.get(f"/api/v1/statistics?{query}")
    assert answer.status == 200, answer.text
    return dict(answer.json)


def test_few_statistics_are_made_at_a_time(filled: RunningPanel) -> None:
    with ExitStack() as others:
        for _ in range(MAX_RECKONING):
            others.enter_context(filled.panel.reckoning.slot())
        calls = ("parts.csv", "statistics", "statistics/yield.png")
        for path in ("/statistics", *(f"/api/v1/{call}" for call in calls)):
            answer = filled.local.get(f"{path}?simulated=only")
            assert (answer.status, answer.headers["retry-after"]) == (503, "2")
        assert filled.local.get("/api/v1/state").status == 200
    assert filled.local.get("/api/v1/statistics?simulated=only").status == 200


def test_the_pages_of_the_history_show_every_part_once_and_as_the_api_does(
    filled: RunningPanel,
) -> None:
    seen: list[int] = []
    address = "/history?simulated=false"
    while address:
        page = filled.local.get(address).text
        seen += numbers_of(page)
        found = re.search(r'href="([^"]*)" rel="next"', page)
        address = unescape(found[1]) if found else ""
    assert seen == list(range(PRODUCED, 0, -1))
    first = filled.local.get("/api/v1/parts?limit=200").json
    rest = filled.local.get(f"/api/v1/parts?limit=200&below={first['next_below']}").json
    assert [part["number"] for part in first["parts"] + rest["parts"]] == seen
    assert rest["next_below"] is None


def test_page_api_csv_and_command_select_the_same_parts(
    filled: RunningPanel, ps4rig: Callable[..., Any]
) -> None:
    since = "2026-11-22T17:30"
    query = f"class=sand&recipe=example&verdict=pass&since={since}"
    page = filled.local.get(f"/history?simulated=false&{query}").text
    table = table_of(filled.local.get(f"/api/v1/parts.csv?{query}").text)
    parts = filled.local.get(f"/api/v1/parts?{query}").json["parts"]
    folder = filled.bench.folder.path
    options = ("--class", "sand", "--recipe", "example", "--verdict", "PASS", "--since", since)
    said = ps4rig("station", "history", folder, "--csv", *options).stdout
    assert 20 < len(table) < PRODUCED / 5
    assert table_of(said) == table
    assert [int(row["number"]) for row in table[::-1]][:50] == numbers_of(page)
    assert [part["number"] for part in parts] == numbers_of(page)
    counted = json.loads(ps4rig("station", "history", folder, "--json", *options).stdout)
    assert len(counted["parts"]) == len(table)
    assert f"Production: {len(table)} parts, {len(table)} PASS" in " ".join(
        re.sub("<[^>]*>", "", page).split()
    )


def test_an_override_is_shown_beside_what_the_station_said(filled: RunningPanel) -> None:
    (entry, _) = (each for each in filled.bench.store.parts() if each.override)
    part_id, reason = entry.result.part_id, entry.result.verdict.reason
    page = filled.local.get(f"/history?simulated=false&part={part_id}").text
    (row,) = rows_of(page)
    assert f"{part_id} PASS station: FAIL Kim: a <hair> station: {reason}" in row
    assert f'href="/parts/{part_id}"' in page


def test_parts_of_a_simulated_rig_are_shown_as_such_and_never_as_production(
    filled: RunningPanel,
) -> None:
    alone, both = (filled.local.get(f"/history{query}").text for query in ("", "?simulated=true"))
    assert min(numbers_of(alone)) == PRODUCED + 11  # the page of a simulated rig shows its parts
    assert f"<strong>SIMULATED</strong>:\n{SIMULATED} parts" in alone
    assert all("SIMULATED" in row for row in rows_of(both))
    assert f"<strong>Production</strong>:\n{PRODUCED} parts" in both
    assert statistics_of(filled)["parts"] == PRODUCED
    assert statistics_of(filled, "simulated=only")["parts"] == SIMULATED
    refused = filled.local.get("/api/v1/statistics?simulated=true")
    assert (refused.status, refused.json["error"].partition(":")[0]) == (400, "simulated")


def test_statistics_are_the_same_on_the_page_and_from_the_api_and_the_command(
    filled: RunningPanel, ps4rig: Callable[..., Any]
) -> None:
    page = filled.local.get("/statistics?simulated=false").text
    found = statistics_of(filled)
    counted = json.loads(
        ps4rig("station", "history", filled.bench.folder.path, "--json").stdout
    )["production"]  # fmt: skip
    assert {name: found[name] for name in counted} == counted
    assert found["verdicts"]["PASS"] == found["station_verdicts"]["PASS"] + 2
    for name, count in found["verdicts"].items():
        assert f'id="count-{name}">{count}<' in page
    assert f'id="parts">{PRODUCED}<' in page
    assert f'id="passed">{100 * found["verdicts"]["PASS"] / PRODUCED:.1f} %<' in page
    figures = found["figures"]
    assert [*figures] == ["yield", "causes", "distance", "led-1", "led-2", "led-3", "led-4"]
    assert sum(row["parts"] for row in figures["yield"]["rows"]) == PRODUCED
    assert sum(row["PASS"] for row in figures["yield"]["rows"]) == found["verdicts"]["PASS"]
    rejected = PRODUCED - found["station_verdicts"]["PASS"]
    assert sum(row["parts"] for row in figures["causes"]["rows"]) == rejected
    assert figures["causes"]["rows"][-1]["cumulative_share"] == pytest.approx(1.0)


def test_each_figure_has_its_numbers_as_csv_and_its_picture(filled: RunningPanel) -> None:
    page = filled.local.get("/statistics?simulated=false").text
    for name, figure in statistics_of(filled)["figures"].items():
        assert f'id="{name}-title"' in page
        answer = filled.local.get(f"/api/v1/statistics/{name}.csv")
        assert answer.headers["content-disposition"] == f'attachment; filename="line-1-{name}.csv"'
        given = [{key: "" if value is None else str(value) for key, value in row.items()}
                 for row in figure["rows"]]  # fmt: skip
        assert table_of(answer.text) == given
        png = filled.local.get(f"/api/v1/statistics/{name}.png")
        assert png.headers["content-type"] == "image/png"
        image = cv2.imdecode(np.frombuffer(png.body, np.uint8), cv2.IMREAD_COLOR)
        assert image.shape[1] == 960
        assert len(np.unique(image)) > 10
    missing = filled.local.get("/api/v1/statistics/gauge.csv")
    assert missing.status == 404
    assert "not among those of the selected parts: yield, causes" in missing.json["error"]


def test_matplotlib_is_loaded_with_the_first_chart() -> None:
    loaded = "import sys, capture.station.panel.server; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", loaded], check=False).returncode == 0


def test_a_page_is_sent_and_others_are_served_while_its_charts_are_drawn(
    filled: RunningPanel, monkeypatch: pytest.MonkeyPatch
) -> None:
    may_end = threading.Event()
    drawing = charts.svg_uri

    def slowly(figure: Figure) -> str:
        assert may_end.wait(WAIT_S)
        return drawing(figure)

    monkeypatch.setattr(charts, "svg_uri", slowly)
    connection = http.client.HTTPConnection(filled.local.host, timeout=WAIT_S)
    try:
        connection.request("GET", "/statistics?simulated=false")
        answer = connection.getresponse()
        while b"<h1>Statistics" not in (line := answer.readline()):
            assert line
        assert filled.local.get("/api/v1/state").status == 200
    finally:
        may_end.set()
    assert answer.read().count(b"data:image/svg+xml") == 7
    connection.close()


def test_the_form_of_a_page_is_on_the_clock_of_the_station(
    filled: RunningPanel, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TZ", "America/New_York")
    time.tzset()
    page = filled.local.get("/history?since=2026-11-22&until=2026-07-01T08:30").text
    monkeypatch.undo()
    time.tzset()
    assert 'name="since" value="2026-11-22T00:00"' in page
    assert 'name="until" value="2026-07-01T08:30"' in page
    link = re.search(r'/api/v1/parts.csv\?([^"]*)', page)
    query = dict(parse_qsl(unescape(link[1])))
    assert query["since"] == "2026-11-22T05:00:00.000Z"
    assert query["until"] == "2026-07-01T12:30:59.999Z"
    assert re.search(r"Times: E[SD]T, UTC-0[45]:00", page)


def test_classes_of_results_are_a_list_that_has_what_is_asked(filled: RunningPanel) -> None:
    page = filled.local.get("/history?class=elsewhere").text
    select = page.partition('<select name="class">')[2].partition("</select>")[0]
    options = re.findall(r"<option[^>]*>([^<]*)", select)
    assert options[0] == "any"
    assert len(options) > 2
    assert "<option selected>elsewhere</option>" in select


def test_a_selection_without_parts_says_so(filled: RunningPanel) -> None:
    assert "No parts are selected" in filled.local.get("/history?class=none").text
    page = filled.local.get("/statistics?class=none")
    assert (page.status, "No parts are selected" in page.text) == (200, True)
    for query in ("class=none", "recipe=../station"):
        assert statistics_of(filled, query)["figures"] == {}


def test_the_last_gauge_study_is_shown_with_parts_of_its_rig(filled: RunningPanel) -> None:
    shown = [Presentation(f"K{n}", n % 2 == 0, Decision.PASS, "fine") for n in range(4)]
    report = GaugeReport.of(shown, "example", None, simulated=True)
    files = filled.bench.folder.recipe_files()
    files.folder.mkdir(exist_ok=True)
    report.write(files.gauge)
    try:
        assert "gauge" not in statistics_of(filled)["figures"]
        figure = statistics_of(filled, "simulated=only")["figures"]["gauge"]
        assert figure["title"] == "Gauge study: unacceptable"
        misses = next(row for row in figure["rows"] if row["measure"] == "misses")
        assert (misses["events"], misses["trials"], misses["acceptable"]) == (2, 2, 0.02)
        assert filled.local.get("/api/v1/statistics/gauge.png?simulated=only").status == 200
        files.gauge.write_text('{"format": "other"}')
        with pytest.raises(InputError, match=r"gauge\.json: .*; run ps4rig station gauge"):
            gauge_of(filled.bench.folder, Selection(simulated=True))
    finally:
        files.gauge.unlink()


@pytest.mark.parametrize("page", ["history", "statistics"])
def test_a_wrong_filter_is_named_on_the_page(filled: RunningPanel, page: str) -> None:
    for name in ("since", "until", "below" if page == "history" else "verdict"):
        answer = filled.local.get(f"/{page}?{name}=yesterday")
        assert (answer.status, name in answer.text) == (400, True)
