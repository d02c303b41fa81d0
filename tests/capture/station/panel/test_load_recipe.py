"""Another recipe by HTTP and in the panel."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from capture.sets.captured_set import CapturedSet
from capture.station.domain.recipe_file import RecipeFolder, read_recipe
from capture.station.domain.users import Role
from capture.station.judge.approval import approve
from capture.station.run.events import RecipeLoaded
from capture.station.run.triggers import Asker, RecipeRefusal, RecipeRefused
from tests.capture.station.panel.pages import logged_in
from tests.capture.station.panel.panels import PASSWORD, RunningPanel, running_panel
from tests.capture.station.stations import FIRST, FakeRecipes
from tests.chromium import Chromium

API = "/api/v1/recipes/example"


@pytest.fixture
def line(station: Path, files: RecipeFolder, captured: CapturedSet) -> Iterator[RunningPanel]:
    """A station that runs another recipe than the approved one of its folder."""
    approve(files, "Ada")
    with running_panel(station, captured, recipes=FakeRecipes()) as running:
        running.panel.users.put("kim", Role.ENGINEER, PASSWORD)
        running.until_ready()
        yield running


def test_an_engineer_loads_a_recipe_by_http(line: RunningPanel) -> None:
    client = line.client(Role.ENGINEER)
    line.parts(1, client)
    assert client.get("/api/v1/recipes").json["running"]["name"] == FIRST
    answer = client.post(f"{API}/load")
    assert (answer.status, answer.json["running"]["name"]) == (200, "example")
    # What comes after the answer is of the new recipe.
    running = client.get("/api/v1/recipes").json["running"]
    assert running == answer.json["running"]
    assert running["by"] == "client-engineer"
    line.parts(1, client)
    parts = client.get("/api/v1/parts?simulated=true").json["parts"]
    assert [each["recipe"] for each in parts] == ["example", FIRST]
    metrics = client.get("/api/v1/metrics").text
    assert f'ps4rig_recipe{{name="example",version="1",sha256="{running["sha256"]}"}} 1' in metrics


def test_a_trigger_by_http_can_require_a_recipe(line: RunningPanel) -> None:
    client = line.client(Role.ENGINEER)

    def trigger(recipe: str, key: str | None = None) -> int:
        headers = {} if key is None else {"Idempotency-Key": key}
        return client.post("/api/v1/trigger", {"recipe": recipe}, **headers).status

    assert trigger("example") == 409
    assert trigger("../x") == 400
    assert trigger(FIRST, "1") == 202
    assert trigger(FIRST, "1") == 200
    assert trigger("example", "1") == 422
    line.until_ready()
    assert client.post(f"{API}/load").status == 200
    assert trigger(FIRST) == 409
    assert trigger("example", "2") == 202


def test_a_recipe_that_is_refused_has_its_reason_and_the_old_one_runs(line: RunningPanel) -> None:
    def refuse(_: str) -> None:
        raise RecipeRefused("part 3 is UNKNOWN", RecipeRefusal.CHALLENGE)

    line.bench.recipes.on_load = refuse
    client = line.client(Role.ENGINEER)
    answer = client.post(f"{API}/load")
    assert answer.status == 409
    assert answer.json == {"error": "part 3 is UNKNOWN", "kind": "CHALLENGE"}
    assert client.get("/api/v1/recipes").json["running"]["name"] == FIRST
    assert client.post("/api/v1/recipes/nobody/load").status == 404
    assert line.client(Role.OPERATOR).post(f"{API}/load").status == 403
    kim = line.local
    kim.log_in("kim")
    page = kim.form("/recipes/example/load")
    assert (page.status, "part 3 is UNKNOWN" in page.text) == (400, True)


def test_only_an_approved_recipe_that_does_not_run_has_a_button(
    line: RunningPanel, files: RecipeFolder
) -> None:
    button = 'aria-label="Load recipe example"'
    kim = line.local
    kim.log_in("kim")
    assert button in kim.get("/recipes").text
    assert button in kim.get("/recipes/example").text
    assert button not in line.client(Role.OPERATOR).get("/recipes").text
    line.live.publish(RecipeLoaded("example", 2, read_recipe(files.file).sha256))
    assert button not in kim.get("/recipes").text
    assert button not in kim.get("/recipes/example").text


def test_the_button_names_the_hash_of_the_recipe_on_the_page(
    line: RunningPanel, files: RecipeFolder
) -> None:
    sha256 = read_recipe(files.file).sha256
    kim = line.local
    kim.log_in("kim")
    for path in ("/recipes", "/recipes/example"):
        assert f'name="sha256" value="{sha256}"><button aria-label="Load' in kim.get(path).text
    line.parts(1, line.client(Role.ENGINEER))
    assert kim.form("/recipes/example/load", sha256=sha256).status == 303
    assert line.bench.recipes.asker == Asker("kim", Role.ENGINEER, sha256, "page")
    assert line.client(Role.ENGINEER).post(f"{API}/load", {"sha256": sha256}).status == 200
    assert line.bench.recipes.asker == Asker("client-engineer", Role.ENGINEER, sha256, "API")


@pytest.mark.browser
def test_a_recipe_is_loaded_by_the_keyboard_and_the_operator_sees_it(
    line: RunningPanel, browser: Chromium
) -> None:
    engineer = logged_in(browser, line, "kim")
    operator = browser.page(line.url)
    assert operator.text("recipe").startswith(FIRST)
    engineer.go(f"{line.url}recipes")
    engineer.tab_to("[aria-label='Load recipe example']")
    engineer.press("Enter")
    engineer.until("!document.querySelector('[aria-label=\\'Load recipe example\\']')")
    operator.until("document.getElementById('recipe').textContent == 'example, version 1'")
    assert operator.errors() == engineer.errors() == []
