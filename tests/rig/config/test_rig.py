"""rig.toml as a whole: refused files and values, and their messages."""

import os
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from rig import ConfigError, RigConfig, load_config

Load = Callable[[str], RigConfig]
SIMULATED = '[lights]\nport = "simulated"\n'


def test_a_file_with_simulated_lights_is_the_default_rig(load: Load) -> None:
    config = load(SIMULATED)
    assert config == RigConfig()
    assert config.is_simulated


@pytest.mark.parametrize("text", ["", 'name = "x"\n', "[lights]\nbaud = 9600\n"])
def test_a_file_without_a_port_is_refused(load: Load, text: str) -> None:
    with pytest.raises(ConfigError, match=r"rig\.toml: lights\.port is missing.*'simulated'"):
        load(text)


@pytest.mark.parametrize(
    ("text", "field"),
    [
        (SIMULATED + "colour = 1\n", "lights.colour"),
        (SIMULATED + "tilts_deg = [0, 90]\n", "lights.tilts_deg has 2 values: .* 3"),
        (SIMULATED + "[camera]\nkind = 'none'\n", "camera.kind"),
        (SIMULATED + "[camera]\nframe_rate_hz = 60\n", "camera: .*exposure_ms = 20 "),
        (SIMULATED + "watchdog_ms = 100\n", "lights.watchdog_ms = 100 "),
        (SIMULATED + "[simulation]\nreadout_ms = 34\n", "readout_ms = 34 "),
        (SIMULATED + "slant_deg = true\n", "lights.slant_deg = true: "),
        ("lights = 3\n", "lights = 3: .*table"),
        ("[lights\n", "not valid TOML"),
        ('[lights]\nport = "a\\u0000b"', "lights.port"),
    ],
)
def test_a_wrong_value_is_refused_with_file_and_key(load: Load, text: str, field: str) -> None:
    with pytest.raises(ConfigError, match=rf"rig\.toml: .*{field}") as caught:
        load(text)
    assert caught.value.exit_status == 2


def test_a_missing_file_says_how_to_simulate(tmp_path: Path) -> None:
    with pytest.raises(
        ConfigError,
        match=r"or use --rig sim",
    ):
        load_config(tmp_path / "rig.toml")


def test_a_file_that_is_not_toml_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.toml")
    (tmp_path / "device.toml").symlink_to("/dev/zero")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    (tmp_path / "large.toml").write_bytes(b"#" * (1 << 21))
    (tmp_path / "deep.toml").write_text("a = " + "[" * 9000, encoding="utf-8")
    name = ".".join("a" * 100_000)  # tomllib takes 11 s
    (tmp_path / "deep-name.toml").write_text(f"[{name}]", encoding="utf-8")
    (tmp_path / "long.toml").write_text("a = " + "9" * 9000, encoding="utf-8")
    began_s = time.process_time()
    for name, message in (
        ("binary.toml", "not valid TOML"),
        ("deep.toml", "not valid TOML"),
        ("deep-name.toml", "more than 20 tables within each other"),
        ("long.toml", "not valid TOML"),
        ("large.toml", "larger than"),
        ("pipe.toml", "cannot be read: it is a pipe or a device"),
        ("device.toml", "cannot be read: it is a pipe or a device"),
    ):
        with pytest.raises(ConfigError, match=message):
            load_config(tmp_path / name)
    with pytest.raises(ConfigError, match="cannot be read"):
        load_config(tmp_path)
    assert time.process_time() - began_s < 3.0


def test_changes_are_validated_as_a_whole() -> None:
    changed = RigConfig().with_changes(camera={"width_px": 64}, lights={"slant_deg": 30.0})
    assert (changed.camera.width_px, changed.camera.height_px) == (64, 512)
    assert changed.lights.slant_deg == 30.0
    with pytest.raises(ConfigError, match=r"camera.*does not fit"):
        changed.with_changes(camera={"frame_rate_hz": 100.0})
    with pytest.raises(ConfigError, match=r"camera\.widht_px"):
        changed.with_changes(camera={"widht_px": 64})
