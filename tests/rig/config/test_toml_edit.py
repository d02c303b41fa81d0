"""A rig.toml keeps its comments and its order when values in it are changed."""

import tomllib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rig import ConfigError, load_config
from rig.config.toml_edit import store_values, with_values

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


def test_values_change_in_place_and_new_keys_end_their_section() -> None:
    changed = with_values(
        BENCH, "camera", {"readout_ms": 8.25, "timestamp_offset_ms": -4.5, "exposure_ms": 10}
    )
    assert changed == BENCH.replace("= 33.3 #", "= 8.25 #").replace(
        "  exposure_ms=20\n", "  exposure_ms=10\ntimestamp_offset_ms = -4.5\n"
    )


def test_a_text_with_a_comment_sign_is_replaced() -> None:
    changed = with_values(BENCH, "camera", {"device": 'a "b" \\ #c'})
    assert 'device = "a \\"b\\" \\\\ #c"  # number 1\n' in changed
    assert tomllib.loads(changed)["camera"]["device"] == 'a "b" \\ #c'


def test_a_new_section_comes_last() -> None:
    assert with_values(BENCH, "simulation", {"ambient": 0.5}) == (
        BENCH + "\n[simulation]\nambient = 0.5\n"
    )
    assert with_values("", "camera", {"gain": 1}) == "[camera]\ngain = 1\n"


def test_line_ends_stay_the_same() -> None:
    windows = BENCH.replace("\n", "\r\n")
    assert with_values(windows, "lights", {"settle_ms": 7.5}) == windows + "settle_ms = 7.5\r\n"


@pytest.mark.parametrize(
    "text",
    [
        'camera = {device = "0", readout_ms = 1}\n',
        "camera.readout_ms = 1\n",
        "camera = 3\n",
        '[camera]\nreadout_ms = """1\n"""\n',
        '[camera]\nnote = """\nreadout_ms = 1\n"""\n',
        "[camera]\nreadout_ms.least = 1\n",
    ],
)
def test_dotted_keys_and_inline_tables_are_refused(text: str) -> None:
    with pytest.raises(ConfigError, match=r"add by hand: readout_ms = 8\.5"):
        with_values(text, "camera", {"readout_ms": 8.5})


TEXTS = st.text(st.characters(categories=["L", "N", "P", "S", "Zs"]), max_size=8)


@given(
    texts=st.dictionaries(st.sampled_from(["a", "b", "c"]), TEXTS),
    number=st.floats(-1000, 1000).map(lambda value: round(value, 2)),
)
def test_any_text_and_number_is_read_back(texts: dict[str, str], number: float) -> None:
    values = {**texts, "n": number}
    changed = with_values(BENCH, "camera", values)
    camera = tomllib.loads(changed)["camera"]
    assert {key: camera[key] for key in values} == values
    assert with_values(changed, "camera", values) == changed


def test_a_stored_file_can_be_loaded_and_keeps_its_mode(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(BENCH)
    path.chmod(0o640)
    store_values(path, {"camera": {"readout_ms": 8.0}, "lights": {"settle_ms": 6.5}})
    config = load_config(path)
    assert (config.camera.readout_ms, config.lights.settle_ms) == (8.0, 6.5)
    assert path.stat().st_mode & 0o777 == 0o640
    assert list(tmp_path.iterdir()) == [path]


def test_a_link_stays_a_link(tmp_path: Path) -> None:
    (tmp_path / "bench.toml").write_text(BENCH)
    link = tmp_path / "rig.toml"
    link.symlink_to("bench.toml")
    store_values(link, {"camera": {"readout_ms": 8.0}})
    assert link.is_symlink()
    assert load_config(tmp_path / "bench.toml").camera.readout_ms == 8.0


def test_a_wrong_value_is_not_stored(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(BENCH)
    with pytest.raises(ConfigError, match=f"^{path}: camera: readout_ms"):
        store_values(path, {"camera": {"readout_ms": 500.0}})
    assert path.read_text() == BENCH
    assert list(tmp_path.iterdir()) == [path]
