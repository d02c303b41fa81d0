"""Teaching and challenge from the panel, in Chromium by the keyboard and by HTTP."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from capture.station.domain.recipe_file import RecipeFolder, read_recipe, write_recipe
from capture.station.domain.users import Role
from tests.capture.station.panel.pages import logged_in
from tests.capture.station.panel.panels import JOB_S, PASSWORD, RunningPanel, running_panel
from tests.capture.station.teaching_sets import acknowledge_faults, patch
from tests.chromium import Chromium, Page

# The first parts of a line: enough of each texture to be taught and for the challenge set.
SURFACES = ["rock", "sand"] * 4 + ["malv"]
LOADED = "document.readyState == 'complete'"


@pytest.fixture
def line(tmp_path: Path) -> Iterator[RunningPanel]:
    """A station without a recipe, with an engineer called kim and parts of all `SURFACES`."""
    sets = [patch(surface, number) for number, surface in enumerate(SURFACES)]
    with running_panel(tmp_path / "line-1", sets[0]) as running:
        for captured in sets:
            running.bench.camera.captured = captured
            running.parts(1)
        running.panel.users.put("kim", Role.ENGINEER, PASSWORD)
        yield running


def ids(surface: str) -> list[str]:
    return [f"part-{n:06d}" for n, each in enumerate(SURFACES, 1) if each == surface]


def until_the_job_ends(page: Page) -> str:
    """Wait for the end of the job that the page shows; return what the page says."""
    page.until(
        f"{LOADED} && location.pathname == '/job' && !document.getElementById('progress')", JOB_S
    )
    return str(page.value("document.querySelector('main').innerText"))


@pytest.mark.slow
@pytest.mark.browser
def test_two_textures_are_taught_challenged_and_approved_by_the_keyboard_alone(
    line: RunningPanel, browser: Chromium
) -> None:
    page = logged_in(browser, line, "kim")
    page.go(f"{line.url}recipes")

    def use(parts: list[str], button: str, texture: str = "", downs: int = 0) -> None:
        """Choose parts, name their texture, choose a verdict by the arrow, press a button."""
        page.until(f"{LOADED} && !!document.querySelector('[name=ids]')")
        for part in sorted(parts, reverse=True):  # the newest is the first on the page
            page.tab_to(f"[name='part.{part}']")
            page.press("Space")
        if texture:
            page.tab_to("[name=texture]")
            page.type(texture)
        if downs:
            page.tab_to("[name=expected]")
        for _ in range(downs):
            page.press("ArrowDown")
        page.tab_to(f"button[value={button}]")
        page.press("Enter")

    page.tab_to("main button")
    page.press("Enter")  # the name of the configured recipe is there
    use(ids("rock")[:3], "good", "rock")
    assert "Version 1 was taught." in until_the_job_ends(page)
    page.tab_to("a[href='/recipes/example/parts']")
    page.press("Enter")
    use(ids("sand")[:3], "good", "sand")
    said = until_the_job_ends(page)
    assert "Version 2 was taught." in said
    assert "sand: 0 of 3 good parts were rejected" in said
    assert "sand: a scratch 3 px wide " in said
    acknowledge_faults(line.panel.folder.recipe_files())
    page.go(f"{line.url}recipes/example/parts")
    use([ids("rock")[3], ids("sand")[3]], "challenge", downs=1)  # PASS
    page.until_at("/recipes/example")
    page.go(f"{line.url}recipes/example/parts")
    use(ids("malv"), "challenge")  # reject
    page.until(f"{LOADED} && document.body.innerText.includes('part-000009.ome.tif')")
    page.tab_to("form[action='/recipes/example/challenge'] p button")
    page.press("Enter")
    assert "3 of 3 parts got the expected verdict" in until_the_job_ends(page)
    page.go(f"{line.url}recipes/example")
    page.tab_to("form[action='/recipes/example/approve'] button")
    page.press("Enter")
    page.until(f"{LOADED} && document.body.innerText.includes('approved by kim')")
    assert page.errors() == []
    recipe = read_recipe(line.panel.folder.recipe_files().file)
    assert (recipe.version, recipe.passes, recipe.is_approved) == (2, ("rock", "sand"), True)


@pytest.mark.slow
def test_the_log_of_changes_names_each_setting_that_teaching_changed(
    station: Path, files: RecipeFolder
) -> None:
    recipe = read_recipe(files.file)
    measured = recipe.limits_of["rock"]
    changed = measured.model_copy(update={"sdq": (0.3, 0.4)})
    write_recipe(files.file, recipe.model_copy(update={"limits_of": {"rock": changed}}))
    files.version(2).measured.unlink()  # so that teaching takes the limit for its own
    with running_panel(station, patch("rock", 3)) as line:
        client = line.client(Role.ENGINEER)
        job = client.job("/api/v1/recipes/example/teach")
        rows = client.get("/api/v1/audit").json["changes"]
    (row,) = (row for row in rows if "limits_of" in row["what"])
    assert row["what"] == "recipe example: limits_of.rock.sdq"
    assert (row["before"], row["after"]) == ("0.3, 0.4", ", ".join(map(str, measured.sdq)))
    assert any("sdq = 0.3, 0.4 is replaced" in remark for remark in job["result"]["remarks"])
