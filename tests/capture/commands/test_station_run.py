"""``ps4rig station init`` and ``run`` as a person and a supervisor use them."""

import json
import re
import signal
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from capture.station.domain.config import (
    CONFIG,
    Retention,
    SimulatedParts,
    StationConfig,
    example_config,
    read_config,
)
from capture.station.domain.interface_config import ModbusConfig, MqttConfig, PanelConfig
from tests.capture.station.production import contradictions, taught_station
from tests.capture.station.teaching_sets import SIDE_PX

Spawn = Callable[..., subprocess.Popen[str]]


def test_init_writes_a_commented_configuration(ps4rig: Any, tmp_path: Path) -> None:
    folder = tmp_path / "line-3"
    made = ps4rig("station", "init", folder)
    assert made.exit_code == 0
    assert "ps4rig station teach" in made.stdout
    assert read_config(folder / CONFIG) == StationConfig(name="line-3", recipe="example")
    assert ps4rig("station", "init", folder).exit_code == 2


def test_the_example_names_every_key() -> None:
    example = example_config("line-3")
    keys = {*re.findall(r"^(?:# )?(\w+) = ", example, re.MULTILINE)}
    sections = {*re.findall(r"^(?:# )?\[(\w+)\]", example, re.MULTILINE)}
    for model in (Retention, SimulatedParts, PanelConfig, ModbusConfig, MqttConfig):
        keys -= {*model.model_fields}
    assert keys | sections == {*StationConfig.model_fields}


def test_init_refuses_a_folder_with_other_files(ps4rig: Any, tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    done = ps4rig("station", "init", tmp_path)
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1)
    assert "is not empty" in done.stderr


def test_a_folder_whose_name_cannot_name_a_station_is_refused(ps4rig: Any, tmp_path: Path) -> None:
    done = ps4rig("station", "init", tmp_path / "line 3")
    assert done.exit_code == 2
    assert not (tmp_path / "line 3" / CONFIG).exists()


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("timer_s = -1", "timer_s = -1"),
        ("triger = 'timer'", "did you mean trigger?"),
        ("results = 'mysql://a/b'", "results"),
    ],
)
def test_a_wrong_key_is_one_line_with_its_value(
    ps4rig: Any, tmp_path: Path, line: str, said: str
) -> None:
    ps4rig("station", "init", tmp_path / "line-3")
    config = tmp_path / "line-3" / CONFIG
    key = line.split(" ")[0]
    kept = [each for each in config.read_text().splitlines() if each.split(" ")[0] != key]
    config.write_text("\n".join([line, *kept]))
    done = ps4rig("station", "run", tmp_path / "line-3")
    assert done.exit_code == 2
    assert said in done.stderr
    assert done.stderr.count("\n") == 1


@pytest.mark.slow
def test_ctrl_c_ends_a_run_after_the_part_in_progress(tmp_path: Path, spawn: Spawn) -> None:
    folder, rig = taught_station(tmp_path / "line-1"), tmp_path / "rig.toml"
    size = f"width_px = {SIDE_PX}\nheight_px = {SIDE_PX}\n"
    rig.write_text(f'[lights]\nport = "simulated"\n[camera]\n{size}')
    command = ("station", "run", folder, "--rig", rig, "--json", "--no-panel")
    process = spawn(*command, "--trigger", "timer")
    events: list[dict[str, Any]] = []
    while not events or events[-1]["event"] != "part":
        events.append(json.loads(process.stdout.readline()))
    # A second run is refused meanwhile.
    second = spawn(*command)
    assert "by ps4rig, process" in second.communicate(timeout=300)[1]
    assert second.returncode == 2
    process.send_signal(signal.SIGINT)
    rest, said = process.communicate(timeout=300)
    events += map(json.loads, rest.splitlines())
    assert (process.returncode, said) == (130, "ps4rig: interrupted\n")
    begun = [event["part_id"] for event in events if event["event"] == "begun"]
    assert begun == [event["part_id"] for event in events if event["event"] == "part"]
    assert events[-1]["event"] == "stopped"
    assert list(contradictions(folder, events)) == []
    # Lines are triggers, and their text is the id of the part; q ends the run.
    third = spawn(*command, stdin=subprocess.PIPE)
    while json.loads(third.stdout.readline()).get("state") != "ready":
        pass
    third.stdin.write("A-7\nq\n")
    third.stdin.flush()
    events = [json.loads(line) for line in third.communicate(timeout=300)[0].splitlines()]
    [part] = [event for event in events if event["event"] == "part"]
    assert part["part_id"] == "A-7"
    assert third.returncode == (0 if part["decision"] == "PASS" else 1)


def test_a_station_without_a_recipe_does_not_run(ps4rig: Any, tmp_path: Path) -> None:
    ps4rig("station", "init", tmp_path / "line-3")
    done = ps4rig("station", "run", tmp_path / "line-3")
    assert done.exit_code == 2
    assert "ps4rig station teach" in done.stderr
