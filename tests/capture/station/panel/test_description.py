"""The description of the API: a generated client calls everything, schemathesis finds nothing."""

import importlib
import json
import pkgutil
import subprocess
import sys
from pathlib import Path
from typing import Any, get_args, get_type_hints

import pytest

from capture.sets.captured_set import CapturedSet
from capture.station.domain.recipe import Recipe
from capture.station.domain.recipe_file import write_recipe
from capture.station.domain.users import Role
from capture.station.domain.verdict import Cause, Decision, Verdict
from tests.capture.station.panel.panels import PASSWORD, RunningPanel
from tests.capture.station.panel.routes import ROUTES
from tests.capture.station.stations import Said
from tests.evidence.station.api_schema import checked

pytestmark = pytest.mark.slow
RECIPE = Recipe(name="example", passes=("rock",))
NAMES = {
    "remove_user": "kim", "remove_client": "kim", "picture": "albedo", "statistics_csv": "yield",
    "statistics_png": "yield",
}  # fmt: skip
# The status of each call in this order, for a recipe that nobody taught, and what it sends.
CALLS: dict[str, tuple[int, dict[str, Any]]] = {
    "openapi": (200, {}), "state": (200, {}), "metrics": (200, {}), "trigger": (202, {}),
    "parts": (200, {}), "parts_csv": (200, {}), "counts": (200, {}), "part": (200, {}),
    "captured_set": (200, {}), "acknowledge": (200, {}), "acknowledge_fault": (409, {}),
    "override": (200, {"decision": "PASS", "reason": "a hair"}), "audit": (200, {}),
    "pictures": (200, {}), "picture": (200, {}),
    "statistics": (200, {}), "statistics_csv": (200, {}), "statistics_png": (200, {}),
    "recipes": (200, {}), "recipe": (200, {}), "versions": (200, {}),
    "save_settings": (200, {"sha256": RECIPE.sha256, "settings": {}}),
    "approve": (409, {"sha256": "0" * 64}), "roll_back": (409, {"sha256": "0" * 64}),
    "load": (409, {}), "teach": (202, {}), "challenge": (200, {}), "replay": (202, {}),
    "add_to_challenge": (201, {"parts": ["A-1"], "expected": "reject"}),
    "remove_from_challenge": (200, {}), "job": (200, {}), "end_job": (200, {}),
    "put_user": (201, {"name": "kim", "role": "operator", "password": PASSWORD}),
    "users": (200, {}), "remove_user": (200, {}),
    "add_client": (201, {"name": "kim", "role": "operator"}),
    "clients": (200, {}), "remove_client": (200, {}),
}  # fmt: skip


@pytest.fixture
def client(panel: RunningPanel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    administrator = panel.client(Role.ADMINISTRATOR)
    document = administrator.get("/api/v1/openapi.json").json
    (tmp_path / "openapi.json").write_text(json.dumps(document))
    command = (sys.executable, "-m", "openapi_python_client", "generate", "--meta", "none",
               "--path", "openapi.json", "--output-path", "station_client")  # fmt: skip
    made = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert "Unable" not in made.stdout
    monkeypatch.syspath_prepend(tmp_path)
    token = administrator.headers["Authorization"].removeprefix("Bearer ")
    return importlib.import_module("station_client").AuthenticatedClient(panel.url, token)


def test_it_calls_everything(panel: RunningPanel, client: Any) -> None:
    write_recipe(panel.bench.folder.recipe_files().file, RECIPE)
    bad = Verdict(Decision.FAIL, "a scratch", (Cause.DEFECT,))
    panel.bench.inspector.inspect = lambda _: Said(bad)
    panel.until_ready()
    panel.local.post("/api/v1/trigger", {"part_id": "A-1"})
    panel.local.get("/api/v1/parts/A-1?wait_s=30")
    panel.until_ready()
    package = importlib.import_module("station_client.api.default")
    there = {module.name for module in pkgutil.iter_modules(package.__path__)}
    assert there == {*CALLS, "events"}
    assert len(there) == sum(route.is_api for route in ROUTES)
    values = {"part_id": "A-1", "file": "A-1.ome.tif", "client": client}
    statuses = {}
    for name, (_, fields) in CALLS.items():
        call = importlib.import_module(f"station_client.api.default.{name}")
        known = get_type_hints(call.sync_detailed)
        given = values | {"name": NAMES.get(name, RECIPE.name)}
        if "body" in known:
            given["body"] = _kind(known["body"]).from_dict(fields)
        if "simulated" in known:
            given["simulated"] = _kind(known["simulated"])("only")
        answer = call.sync_detailed(**{key: given[key] for key in given if key in known})
        statuses[name] = int(answer.status_code)
    assert statuses == {name: status for name, (status, _) in CALLS.items()}
    # It never ends: only its begin is read.
    events = importlib.import_module("station_client.api.default.events")
    with client.get_httpx_client().stream(**events._get_kwargs()) as stream:
        assert stream.status_code == 200
        assert next(stream.iter_lines()).startswith("retry: ")


def test_schemathesis_finds_nothing(captured: CapturedSet, tmp_path: Path) -> None:
    """`tests.evidence.station.api_schema` runs it for five minutes."""
    run = checked(tmp_path, captured, 20)
    assert run.returncode == 0, run.stdout


def _kind(hint: Any) -> Any:
    """The first type of a union."""
    return (get_args(hint) or (hint,))[0]
