"""A rig.toml keeps its comments and its order when values in it are changed."""

import tomllib
from pathlib import Path

import pytest

from rig import ConfigError, load_config
from rig.config.rig import store_values

BENCH = """\
# the bench by the window
name = "bench"   # ours

[camera]  # a good one
device = "/dev/v4l/by-id/cam # 1"  # number 1
readout_ms = 33.3 # not measured yet
  exposure_ms=20

# the light controller
[lights]
port = "/dev/ttyACM0"
"""


def stored(path: Path, text: str, sections: dict[str, dict[str, str | float]]) -> str:
    path.write_bytes(text.encode())
    store_values(path, sections)
    return path.read_bytes().decode()


def test_values_change_in_place_and_new_keys_end_their_section(tmp_path: Path) -> None:
    values = {"readout_ms": 8.25, "timestamp_offset_ms": -4.5, "exposure_ms": 10}
    changed = stored(tmp_path / "rig.toml", BENCH, {"camera": values})
    assert changed == BENCH.replace("= 33.3 #", "= 8.25 #").replace(
        "  exposure_ms=20\n", "  exposure_ms=10\ntimestamp_offset_ms = -4.5\n"
    )


def test_a_new_section_comes_last(tmp_path: Path) -> None:
    changed = stored(tmp_path / "rig.toml", BENCH, {"simulation": {"ambient": 0.5}})
    assert changed == BENCH + "\n[simulation]\nambient = 0.5\n"


@pytest.mark.parametrize(
    "camera",
    [
        'camera = {device = "0"}',
        'camera = {device = "0", readout_ms = 1}',
        'camera.device = "0"',
        '[camera]\ndevice = "0"\nreadout_ms = 1',
    ],
)
def test_every_form_of_a_section_is_changed(tmp_path: Path, camera: str) -> None:
    text = f'lights.port = "/dev/ttyACM0"\n{camera}'
    expected = tomllib.loads(text)
    expected["camera"]["readout_ms"] = 8.5
    changed = stored(tmp_path / "rig.toml", text, {"camera": {"readout_ms": 8.5}})
    assert tomllib.loads(changed) == expected


def test_a_stored_file_can_be_loaded_and_keeps_its_mode(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(BENCH)
    path.chmod(0o640)
    store_values(path, {"camera": {"readout_ms": 8.0}, "lights": {"settle_ms": 6.5}})
    config = load_config(path)
    assert (config.camera.readout_ms, config.lights.settle_ms) == (8.0, 6.5)
    assert path.stat().st_mode & 0o777 == 0o640
    assert list(tmp_path.iterdir()) == [path]


def test_a_wrong_value_is_not_stored(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(BENCH)
    with pytest.raises(ConfigError, match=f"^{path}: camera: readout_ms"):
        store_values(path, {"camera": {"readout_ms": 500.0}})
    assert path.read_text() == BENCH
    assert list(tmp_path.iterdir()) == [path]
