"""Recipes in the panel and by HTTP: settings, approval, roll back, challenge set, parts."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from capture.sets.captured_set import CapturedSet
from capture.station.domain.recipe import Recipe
from capture.station.domain.recipe_file import read_recipe
from capture.station.domain.users import Role
from capture.station.panel.background_jobs import Job
from capture.station.results.database import ResultsUnavailable
from capture.station.run.events import RecipeLoaded
from tests.capture.station.panel.panels import PASSWORD, Client, RunningPanel, running_panel
from tests.capture.station.panel.test_background_jobs import wait

PAGE, API = "/recipes/example", "/api/v1/recipes/example"


@pytest.fixture
def line(station: Path, captured: CapturedSet) -> Iterator[RunningPanel]:
    """A taught station with an engineer called kim and two parts."""
    with running_panel(station, captured) as running:
        running.parts(2)
        running.panel.users.put("kim", Role.ENGINEER, PASSWORD)
        yield running


@pytest.fixture
def kim(line: RunningPanel) -> Client:
    browser = line.local
    browser.log_in("kim")
    return browser


def recipe_of(line: RunningPanel) -> Recipe:
    return read_recipe(line.panel.folder.recipe_files().file)


def fields_of(text: str) -> dict[str, str]:
    """The values that a browser would send of the form of the settings."""
    form = text.partition('class="settings"')[2]
    found = dict(
        re.findall(r'<input (?:id="[^"]*" |type="hidden" )name="([^"]+)" value="([^"]*)"', form)
    )
    for name, options in re.findall(r'<select name="([^"]+)">(.*?)</select>', form):
        found[name] = re.search(r'value="(\w+)" selected', options)[1]  # type: ignore[index]
    return found


def changes(line: RunningPanel) -> list[tuple[str, str, str | None, str | None]]:
    """What the log says of recipes, the oldest first."""
    rows = line.client(Role.ENGINEER).get("/api/v1/audit").json["changes"]
    found = [(row["by"], row["what"], row["before"], row["after"]) for row in rows]
    return [row for row in found[::-1] if row[1].startswith("recipe")]


def test_changed_settings_are_a_state_that_nobody_approved(line: RunningPanel, kim: Client) -> None:
    before = recipe_of(line)
    assert kim.form(f"{PAGE}/approve", sha256=before.sha256).status == 303
    assert kim.form(f"{PAGE}/approve", sha256=before.sha256).status == 303  # a second click
    form = fields_of(kim.get(f"{PAGE}/settings").text)
    given = form | {"limits.margin": "0.3", "orientation.tolerance_deg": "5", "note": "sheet 7"}
    assert kim.form(f"{PAGE}/settings", **given).status == 303
    after = recipe_of(line)
    assert (after.limits.margin, after.orientation.tolerance_deg) == (0.3, 5.0)
    assert (
        after.model_copy(
            update={each: getattr(before, each) for each in ("limits", "orientation", "note")}
        )
        == before
    )
    assert not after.is_approved
    assert "not approved" in kim.get(PAGE).text
    assert changes(line) == [
        ("kim", "recipe example", f"version 2, {before.sha256[:8]}, not approved",
         f"version 2, {before.sha256[:8]}, approved by kim"),
        ("kim", "recipe example: note", None, "sheet 7"),
        ("kim", "recipe example: orientation.tolerance_deg", None, "5.0"),
        ("kim", "recipe example: limits.margin", None, "0.3"),
    ]  # fmt: skip


def test_a_wrong_value_is_named_beside_its_field_and_nothing_is_saved(
    line: RunningPanel, kim: Client
) -> None:
    before = recipe_of(line)
    form = fields_of(kim.get(f"{PAGE}/settings").text)
    wrong = {
        "limits.margin": "2",
        "limits.defect": "<b>",
        "region.x": "7",
        "limits_of.0.sdq.0": "9",
    }
    answer = kim.form(f"{PAGE}/settings", **form | wrong)
    assert answer.status == 400
    for name, message in (
        ("limits.margin", "must be less than or equal to 1"),
        ("limits.defect", "must be a number"),
        ("region.height", "is missing; give it"),
    ):
        field = re.search(f'<input id="{name}".*?</div>', answer.text, re.DOTALL)
        assert 'aria-invalid="true"' in field[0]
        assert f'<b class="wrong">{message}</b>' in field[0]
    assert "sdq = [9" in answer.text
    assert 'value="2"' in answer.text
    assert "<b>&#34;" not in answer.text
    assert recipe_of(line) == before
    assert changes(line) == []
    wrong_by_api = {"sha256": before.sha256, "settings": {"limits": {"margin": 2}, "name": "x"}}
    by_api = line.client(Role.ENGINEER).post(f"{API}/settings", wrong_by_api)
    assert (by_api.status, list(by_api.json["settings"])) == (400, ["name"])


def test_of_two_engineers_who_change_settings_at_once_the_second_is_told(
    line: RunningPanel, kim: Client
) -> None:
    line.panel.users.put("ada", Role.ENGINEER, PASSWORD)
    ada = line.local
    ada.log_in("ada")
    forms = [fields_of(each.get(f"{PAGE}/settings").text) for each in (kim, ada)]
    given = forms[0] | {"limits.margin": "0.3"}
    assert kim.form(f"{PAGE}/settings", **given).status == 303
    late = ada.form(f"{PAGE}/settings", **forms[1] | {"limits.margin": "0.2"})
    assert late.status == 400
    assert "was changed by somebody else" in late.text
    assert recipe_of(line).limits.margin == 0.3
    assert len(changes(line)) == 1
    # The form of a session that is over.
    kim.form("/logout")
    over = kim.form(f"{PAGE}/settings", **given | {"limits.margin": "0.4"})
    assert over.status == 401
    assert "nothing was changed: the session is over" in over.text
    assert '<a href="/login">Log in</a>' in over.text
    assert recipe_of(line).limits.margin == 0.3


def test_programs_change_approve_and_roll_back_recipes(line: RunningPanel) -> None:
    client = line.client(Role.ENGINEER)
    first = client.get(API).json
    assert (first["is_approved"], first["problem"], first["is_running"]) == (False, None, False)
    assert first["least_found"][0]["text"].startswith("a scratch 2 px wide ")
    line.live.publish(RecipeLoaded("example", 2, first["sha256"]))
    assert client.get(API).json["is_running"]
    assert "version 2</b>, " + first["sha256"][:8] in client.get(PAGE).text
    seen = {"sha256": first["sha256"]}
    assert client.post(f"{API}/approve", seen).json["approval"]["by"] == "client-engineer"
    changed = client.post(f"{API}/settings", seen | {"settings": {"limits": {"blur_px": 0.5}}}).json
    assert (changed["limits"]["blur_px"], changed["is_approved"]) == (0.5, False)
    assert client.post(f"{API}/approve", seen).status == 409  # of another state
    client.post(f"{API}/approve", {"sha256": changed["sha256"]})
    approved = client.get(f"{API}/versions").json["approved"]
    assert {each["sha256"] for each in approved} == {first["sha256"], changed["sha256"]}
    back = client.post(f"{API}/rollback", seen).json
    assert (back["sha256"], back["is_approved"]) == (first["sha256"], True)
    assert client.post(f"{API}/rollback", {"sha256": "0" * 64}).status == 409
    assert changes(line)[-1][3] == (
        f"roll back to version 2, {first['sha256'][:8]}, approved by client-engineer"
    )
    assert client.get("/api/v1/recipes").json["running"]["version"] == 2


def test_a_part_of_the_history_comes_into_the_challenge_set_and_out_again(
    line: RunningPanel, kim: Client
) -> None:
    page = kim.get(f"{PAGE}/parts").text
    assert 'name="part.part-000002"' in page
    given = kim.get(f"{PAGE}/parts?ids=part-000001,part-000000").text
    assert 'name="part.part-000001" checked' in given
    assert 'name="ids" value="part-000000"' in given
    chosen = {"part.part-000002": "on", "use": "challenge", "expected": "FAIL"}
    assert kim.form(f"{PAGE}/parts", **chosen).status == 303
    assert "part-000002.ome.tif" in kim.get(PAGE).text
    assert "in the challenge set: FAIL" in kim.get(f"{PAGE}/parts").text
    # Another page of parts keeps what is chosen and typed.
    seen = {"use": "look", "part.part-000002": "on", "ids": "part-7", "texture": "rock"}
    older = kim.form(f"{PAGE}/parts?below=2", **seen)
    assert older.status == 200
    assert 'name="part.part-000002"' not in older.text
    assert 'name="part.part-000001">' in older.text
    assert 'name="ids" value="part-000002 part-7"' in older.text
    assert 'value="rock"' in older.text
    newest = kim.form(f"{PAGE}/parts", use="look", ids="part-000002 part-7").text
    assert 'name="part.part-000002" checked' in newest
    assert 'name="ids" value="part-7"' in newest
    for wrong, said in (
        (
            {"use": "challenge", "expected": "ERROR", "ids": "part-000001"},
            "give reject, PASS, FAIL",
        ),
        ({"use": "challenge", "expected": "PASS", "ids": "part-9"}, "there is no result of it"),
        ({"use": "good", "texture": "rock"}, "choose a part"),
        ({"use": "good", "texture": "unknown", "ids": "part-000001"}, "matches no class"),
        ({"use": "eat"}, "give good, bad, again, challenge or look"),
    ):
        answer = kim.form(f"{PAGE}/parts", **wrong)
        assert (answer.status, said in answer.text) == (400, True), said
    assert kim.form(f"{PAGE}/challenge", remove="part-000002.ome.tif").status == 303
    assert "part-000002.ome.tif" not in kim.get(PAGE).text
    assert kim.form(f"{PAGE}/challenge", remove="../taught.json").status == 400
    assert [row[1:] for row in changes(line)] == [
        ("recipe example: challenge part part-000002.ome.tif", None, "FAIL"),
        ("recipe example: challenge part part-000002.ome.tif", "FAIL", None),
    ]


def test_a_job_beside_another_is_refused_and_has_no_row(line: RunningPanel) -> None:
    line.panel.jobs.start(Job("teach", "example", "Teach 3 parts", "Ada"), lambda: wait)
    refused = line.client(Role.ENGINEER).post(f"{API}/challenge")
    assert (refused.status, "Teach 3 parts: is running" in refused.text) == (409, True)
    assert changes(line) == []


def test_a_job_whose_begin_cannot_be_recorded_is_refused(
    line: RunningPanel, monkeypatch: pytest.MonkeyPatch
) -> None:
    def record(*_: Any) -> None:
        raise ResultsUnavailable("locked")

    monkeypatch.setattr(line.panel.results, "record", record)
    client = line.client(Role.ENGINEER)
    for call, fields in (("challenge", None), ("teach", {})):
        refused = client.post(f"{API}/{call}", fields)
        assert (refused.status, refused.json) == (503, {"error": "locked"})
    assert client.get("/api/v1/job").status == 404
    assert not line.panel.folder.recipe_files().replay.exists()
    monkeypatch.undo()
    assert client.job(f"{API}/challenge")["status"] == "done"


def test_the_report_of_teaching_is_served_without_scripts(line: RunningPanel) -> None:
    report = line.panel.folder.recipe_files().version(2).report
    report.write_text("<p>found</p><script>alert(1)</script>")
    operator = line.client(Role.OPERATOR)
    answer = operator.get(f"{PAGE}/versions/2/teaching")
    assert answer.text.startswith("<p>found</p>")
    policy = answer.headers["content-security-policy"]
    assert "sandbox" in policy
    assert "script-src" not in policy  # default-src is none
    for place in ("3", "2x", "..%2f..", "%C2%B2"):
        assert operator.get(f"{PAGE}/versions/{place}/teaching").status == 404
    for name in ("..%2fstation", "%2e%2e", "nobody"):
        assert operator.get(f"/recipes/{name}").status in (404, 405)


def test_a_file_that_is_no_recipe_does_not_hide_the_others(line: RunningPanel) -> None:
    recipes = line.panel.folder.recipe_files().file.parent
    (recipes / "a strange name.toml").write_text("")
    (recipes / "damaged.toml").write_text("version = [")
    page = line.client(Role.OPERATOR).get("/recipes").text
    assert "a strange name" in page
    assert "damaged.toml: not valid TOML" in page
    assert '<a href="/recipes/example">example</a>' in page
    assert "This run judges no part." in page  # the fake station has loaded no recipe
    assert line.client(Role.OPERATOR).get("/recipes/damaged").status == 400


def test_an_operator_sees_all_without_a_form(line: RunningPanel) -> None:
    operator = line.client(Role.OPERATOR)
    page = operator.get(PAGE).text
    assert "<form" not in page.partition("<main")[2]
