"""`ps4rig station run` with a PLC and a broker in its `station.toml`."""

import json
import re
import signal
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

import pytest

from capture.commands.station_interfaces import mqtt_publisher, plc_line, serving_plc_line
from capture.station.domain.config import StationConfig
from capture.station.domain.folder import StationFolder, make_station
from capture.station.domain.interface_config import ModbusConfig, MqttConfig
from capture.station.domain.recipe_file import RecipeFolder
from capture.station.judge.approval import approve
from capture.station.run.live_station import LiveStation
from classify.base.errors import InputError
from tests.capture.station.production import configure

PARTS = 3


def test_a_plc_is_served_if_section_or_trigger_asks_for_it() -> None:
    live = LiveStation("line-1", simulated=True)
    without = StationConfig(name="line-1", recipe="example")
    with_section = without.model_copy(update={"modbus": ModbusConfig()})
    assert plc_line(without, live, "timer") is None
    assert plc_line(without, live, "modbus") is not None
    assert plc_line(with_section, live, "timer") is not None


@pytest.mark.parametrize(
    ("extra", "package", "module"), [("modbus", "pymodbus", "modbus"), ("mqtt", "paho", "mqtt")]
)
def test_a_missing_package_is_named_with_the_way_to_install_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, extra: str, package: str, module: str
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    for name in [name for name in sys.modules if name.startswith(f"{package}.")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.delitem(sys.modules, f"capture.station.line.{module}", raising=False)
    live = LiveStation("line-1", simulated=True)
    line = plc_line(StationConfig(name="line-1", recipe="example"), live, "modbus")
    assert line is not None
    said = rf"^\[{extra}\] needs {package}.*: pip install 'ps4rig\[{extra}\]'$"
    settings = MqttConfig(url="mqtt://broker", topic="a")
    make_station(tmp_path / "line-1")
    with pytest.raises(InputError, match=said), ExitStack() as stack:
        stack.enter_context(
            serving_plc_line(line, None)
            if extra == "modbus"
            else mqtt_publisher(settings, StationFolder(tmp_path / "line-1"))
        )


@pytest.mark.slow
def test_a_run_prints_its_modbus_address_and_takes_the_triggers_of_the_example_client(
    station: Path, files: RecipeFolder, small_rig: Path
) -> None:
    assert small_rig
    approve(files, "Ada")
    configure(station)
    with (station / "station.toml").open("a", encoding="utf-8") as config:
        config.write('[modbus]\nport = 0\nrecipes = ["example"]\n')
        config.write('[mqtt]\nurl = "mqtt://127.0.0.1:9"\ntopic = "plant"\n')  # nobody listens
    options = ("--no-panel", "--trigger", "modbus")
    command = (sys.executable, "-m", "capture", "station", "run", str(station), *options)
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as run:
        found = re.search(r"modbus: (\S+):(\d+)", run.stderr.readline())
        client = (sys.executable, "-m", "capture.station.line.example_client", found[1], found[2])
        sorted_parts = subprocess.check_output(
            (*client, "--parts", str(PARTS), "--name", "A"), text=True, timeout=300
        )
        run.send_signal(signal.SIGINT)
        said = run.stdout.read()
    verdicts = dict(zip((1, 2, 3, 4), ("PASS", "FAIL", "UNKNOWN", "ERROR"), strict=True))
    judged = [json.loads(line) for line in sorted_parts.splitlines()]
    parts = [f"{each['part_id']} {verdicts[each['verdict']]}, simulated" for each in judged]
    assert [line.partition(":")[0] for line in said.splitlines() if "simulated:" in line] == parts
    assert [each["number"] for each in judged] == [1, 2, 3]
    assert run.returncode == 130
    assert "mqtt 127.0.0.1: cannot be reached" in (station / "station.log").read_text(
        encoding="utf-8"
    )
