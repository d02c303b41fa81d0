"""Schemathesis against the HTTP API of a station with a fake rig: no finding.

    python -m tests.evidence.station.api_schema [--seconds N]

Requests that the description allows and such that it refuses, in sequences that follow from the
description, by an administrator. The event stream, which never ends, is left out.
"""

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

from capture.sets.captured_set import CapturedSet
from capture.station.domain.folder import StationFolder, make_station
from capture.station.domain.interface_config import PanelConfig
from capture.station.domain.recipe import Recipe
from capture.station.domain.recipe_file import write_recipe
from capture.station.domain.users import Role, Users
from tests.capture.station.panel.panels import PASSWORD, running_panel
from tests.capture.station.stations import small_set

# A trigger whose id is none is refused with 409, and recorded. Valid requests may name what is not
# there, and may not fit the state of the station or the earlier request with the same key.
_CONFIG = """
[checks]
negative_data_rejection.expected-statuses = ["400", "401", "404", "409", "415", "503"]
positive_data_acceptance.expected-statuses = ["2xx", "401", "404", "409", "422", "503"]
"""
_LONGEST_ANSWER_S = 60.0  # a call waits up to 30 s for a part


def checked(folder: Path, captured: CapturedSet, seconds: int) -> subprocess.CompletedProcess[str]:
    """Run schemathesis against a panel; its status is 0 without a finding."""
    station = folder / "line-1"
    make_station(station)
    write_recipe(
        StationFolder(station).recipe_files().file, Recipe(name="example", passes=("rock",))
    )
    Users(station).put("ada", Role.ADMINISTRATOR, PASSWORD)
    # Behind a proxy nobody is local: a login is needed also when all users were removed.
    settings = PanelConfig(port=0, behind_proxy=True)
    with running_panel(station, captured, settings) as panel:
        client = panel.client(Role.ADMINISTRATOR)
        (folder / "openapi.json").write_bytes(client.get("/api/v1/openapi.json").body)
        (folder / "schemathesis.toml").write_text(_CONFIG)
        command = (
            Path(sys.executable).with_name("schemathesis"), "run", "openapi.json",
            "--url", panel.url.rstrip("/"), "--max-time", str(seconds),
            "--header", f"Authorization: {client.headers['Authorization']}",
            "--exclude-operation-id", "events", "--checks", "all",
            "--max-response-time", str(_LONGEST_ANSWER_S),
            "--request-timeout", str(_LONGEST_ANSWER_S),
            "--suppress-health-check", "all", "--no-color",
        )  # fmt: skip
        return subprocess.run(command, cwd=folder, capture_output=True, text=True)


def main() -> int:
    """Print what schemathesis says."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=int, default=300)
    with tempfile.TemporaryDirectory() as folder:
        run = checked(Path(folder), small_set(), parser.parse_args().seconds)
    print(run.stdout + run.stderr)
    return run.returncode


if __name__ == "__main__":
    sys.exit(main())
