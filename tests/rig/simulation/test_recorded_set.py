"""A camera that replays a captured set."""

from pathlib import Path

import numpy as np
import pytest

from capture import CapturedSet, capture_set
from classify.base.errors import InputError
from rig import Placement, RigConfig, load_config, open_rig

CAMERA = {"width_px": 40, "height_px": 24}


@pytest.fixture(scope="module")
def oak(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("sets") / "oak.ome.tif"
    with open_rig(RigConfig().with_changes(camera=CAMERA)) as rig:
        capture_set(rig, "oak").save(path)
    return path


def replay(path: Path, **changes: dict[str, object]) -> RigConfig:
    camera = {"kind": "replay", "set_file": str(path)} | changes.pop("camera", {})
    return RigConfig().with_changes(camera=camera, **changes)


def test_a_replayed_set_has_the_same_pixels_and_names_its_origin(oak: Path) -> None:
    original = CapturedSet.load(oak)
    with open_rig(replay(oak)) as rig:
        again = capture_set(rig, "again")
    np.testing.assert_array_equal(again.images, original.images)
    np.testing.assert_array_equal(again.ambient, original.ambient)
    metadata = again.metadata
    assert metadata.simulated
    assert metadata.placement is None
    assert metadata.camera is not None
    assert metadata.camera.kind == "replay"
    origin = metadata.camera.controls["replay"]
    assert origin["set_file"] == str(oak)
    assert origin["pixels_sha256"] == original.metadata.pixels_sha256
    assert again.noise == original.noise


def test_a_replayed_frame_shows_the_led_of_its_exposure(oak: Path) -> None:
    original = CapturedSet.load(oak)
    assert original.ambient is not None
    with open_rig(replay(oak)) as rig:
        switch = rig.lights.select(2)
        rig.clock.sleep_s(0.5)
        rig.lights.select(3)
        shown = [rig.camera.read(1.0) for _ in range(7)]
    by_light = [original.ambient, *original.images]
    lights = [
        next((k for k, image in enumerate(by_light) if np.array_equal(frame.pixels, image)), None)
        for frame in shown
    ]
    # Stale frames of LED 2 wait in the queue, the first one a mixture.
    assert lights[1:4] == [3, 3, 3]
    assert lights[-1] == 4
    assert shown[1].exposure_start_s > switch.acknowledged_s


@pytest.mark.parametrize("who", ["strobe", "trigger"])
def test_a_set_is_replayed_in_a_sequence_of_the_controller(oak: Path, who: str) -> None:
    with open_rig(replay(oak, lights={"synchronisation": who})) as rig:
        again = capture_set(rig)
    np.testing.assert_array_equal(again.images, CapturedSet.load(oak).images)


def test_a_set_of_8_bits_is_replayed_with_8_bits(tmp_path: Path) -> None:
    path = tmp_path / "a.ome.tif"
    with open_rig(RigConfig().with_changes(camera={**CAMERA, "bits": 8})) as rig:
        capture_set(rig).save(path)
    with open_rig(replay(path)) as rig:
        assert rig.camera.info.bit_depth == 8
        assert rig.camera.read(1.0).pixels.dtype == np.uint8


def test_an_average_is_replayed_at_its_own_depth(tmp_path: Path) -> None:
    path = tmp_path / "a.ome.tif"
    with open_rig(RigConfig().with_changes(camera=CAMERA)) as rig:
        capture_set(rig, average=3).save(path)
    with open_rig(replay(path)) as rig:
        assert rig.camera.info.bit_depth == 16
        # The noise of an average is not that of one frame.
        assert rig.camera.info.gain_e_per_dn is None
        np.testing.assert_array_equal(capture_set(rig).images, CapturedSet.load(path).images)


def test_the_file_is_found_beside_rig_toml(oak: Path) -> None:
    path = oak.parent / "rig.toml"
    path.write_text(
        f'[lights]\nport = "simulated"\n[camera]\nkind = "replay"\nset_file = "{oak.name}"\n'
    )
    assert load_config(path).camera.set_file == str(oak)


def test_other_light_directions_are_refused(oak: Path) -> None:
    with pytest.raises(InputError, match=r"tilts 0, 90, 180, 270 at slants 45"):
        open_rig(replay(oak, lights={"slant_deg": 30.0}))
    with pytest.raises(InputError, match=r"set lights\.tilts_deg"):
        open_rig(replay(oak, lights={"tilts_deg": [0.0, 120.0, 240.0]}))


def test_no_part_can_be_put_below_a_replaying_camera(oak: Path) -> None:
    with open_rig(replay(oak)) as rig:
        assert rig.simulation is not None
        with pytest.raises(InputError, match="replays a set"):
            rig.simulation.place(Placement())


def test_a_file_that_is_not_a_set_is_named(tmp_path: Path) -> None:
    path = tmp_path / "x.ome.tif"
    with pytest.raises(InputError, match=r"x\.ome\.tif: no such file"):
        open_rig(replay(path))
    path.write_bytes(b"no tiff at all")
    with pytest.raises(InputError, match=r"x\.ome\.tif: .*TIFF"):
        open_rig(replay(path))


def test_a_changed_set_is_refused(oak: Path, tmp_path: Path) -> None:
    data = bytearray(oak.read_bytes())
    data[len(data) // 2] ^= 1
    path = tmp_path / "changed.ome.tif"
    path.write_bytes(data)
    with pytest.raises(InputError, match="changed"):
        open_rig(replay(path))


@pytest.mark.parametrize(("field", "value"), [("bit_depth", 10**9), ("full_scale", 4094)])
def test_a_set_with_impossible_metadata_is_refused(
    oak: Path, tmp_path: Path, field: str, value: object
) -> None:
    path, captured = tmp_path / "x.ome.tif", CapturedSet.load(oak)
    metadata = captured.metadata.model_copy(update={field: value})
    CapturedSet(captured.images, captured.ambient, metadata).save(path)
    with pytest.raises(InputError, match=rf"x\.ome\.tif: .*{value}"):
        open_rig(replay(path))
