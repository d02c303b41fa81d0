"""The command verify."""

import json
import os
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from capture import CapturedSet
from capture.session.folder import make_session, session_folder
from capture.session.journal import SetEntry

Command = Callable[..., Any]
Refused = Callable[..., str]
DATA = Path(__file__).parents[2] / "data" / "sets"
PLAN = 'name = "stones"\norientations_deg = [0, 50]\n[[specimen]]\nid = "rock"\nsurface = "rock"\n'


@pytest.fixture
def archive(sets: Path, library: Path, tmp_path: Path) -> Path:
    """A folder with two sets, a library, and a session of both sets."""
    folder = tmp_path / "archive"
    shutil.copytree(sets, folder / "plain")
    shutil.copy(library, folder / "textures.ps4lib")
    plan = folder / "stones.toml"
    plan.write_text(PLAN)
    with session_folder(make_session(plan)) as session:
        for planned, name in zip(session.plan.sets(), ("001", "002"), strict=True):
            path = session.file_of(planned)
            shutil.copy(sets / f"rock-{name}.ome.tif", path)
            session.update(
                session.journal.with_entry(
                    SetEntry(
                        specimen=planned.specimen,
                        orientation_deg=planned.orientation_deg,
                        repeat=1,
                        file=f"sets/{path.name}",
                        pixels_sha256=CapturedSet.load(path).metadata.pixels_sha256,
                    )
                )
            )
    return folder


def states(ps4rig: Command, folder: Path, status: int) -> dict[str, str]:
    result = ps4rig("verify", folder, "--json")
    assert result.exit_code == status, result.stderr
    findings = json.loads(result.stdout)["findings"]
    return {str(Path(each["path"]).relative_to(folder)): each["state"] for each in findings}


def test_a_whole_archive_is_good(ps4rig: Command, archive: Path) -> None:
    result = ps4rig("verify", archive)
    assert (result.exit_code, result.stdout) == (0, "files: 8 good\n")
    assert states(ps4rig, archive, 0) == {}


def test_a_pipe_and_a_broken_link_are_not_good(
    ps4rig: Command, refused: Refused, archive: Path
) -> None:
    os.mkfifo(archive / "plain" / "pipe.ome.tif")
    (archive / "plain" / "gone.ps4lib").symlink_to("nowhere")
    bad = {"plain/pipe.ome.tif": "altered", "plain/gone.ps4lib": "altered"}
    assert states(ps4rig, archive, 1) == bad
    assert "give its folder" in refused("verify", archive / "textures.ps4lib")


def flip(path: Path, offset: int) -> None:
    data = bytearray(path.read_bytes())
    data[offset] ^= 0xFF
    path.write_bytes(data)


def test_every_alteration_is_found(ps4rig: Command, archive: Path) -> None:
    flip(archive / "plain" / "sand-001.ome.tif", -3000)
    flip(archive / "textures.ps4lib", 20_000)  # in an array
    session = archive / "stones"
    (session / "sets" / "rock-0-1.ome.tif").unlink()
    # A whole set, but not the one that was captured.
    shutil.copy(archive / "plain" / "sand-002.ome.tif", session / "sets" / "rock-50-1.ome.tif")
    shutil.copy(archive / "plain" / "sand-002.ome.tif", session / "sets" / "other.ome.tif")
    later = re.sub(rb'("schema_version": )\d', rb"\g<1>9", (DATA / "rock.ome.tif").read_bytes())
    (archive / "later.ome.tif").write_bytes(later)
    assert states(ps4rig, archive, 1) == {
        "plain/sand-001.ome.tif": "altered",
        "textures.ps4lib": "altered",
        "stones/sets/rock-0-1.ome.tif": "missing",
        "stones/sets/rock-50-1.ome.tif": "altered",
        "stones/sets/other.ome.tif": "not in journal",
        "later.ome.tif": "other version",
    }
    said = ps4rig("verify", archive).stdout.splitlines()
    assert f"{archive / 'later.ome.tif'}: other version: " in said[0]


def test_a_set_without_its_calibration_is_found(ps4rig: Command, archive: Path) -> None:
    path = archive / "plain" / "rock-001.ome.tif"
    captured = CapturedSet.load(path)
    about = captured.metadata.model_copy(update={"calibration_ids": ("0" * 64,)})
    CapturedSet(captured.images, captured.ambient, about).save(path)
    assert states(ps4rig, archive, 1) == {"plain/rock-001.ome.tif": "without calibration"}


def test_a_damaged_journal_is_found(ps4rig: Command, archive: Path) -> None:
    (archive / "stones" / "journal.json").write_text("{")
    assert states(ps4rig, archive, 1) == {"stones/journal.json": "altered"}


def test_a_folder_without_files_of_ps4rig_is_refused(refused: Refused, tmp_path: Path) -> None:
    assert "holds no captured sets" in refused("verify", tmp_path)
    assert "no such folder" in refused("verify", tmp_path / "none")
