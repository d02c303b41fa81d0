"""No set file of a part is ever replaced by that of another part."""

import shutil
from pathlib import Path

import pytest

from capture.station.domain.config import CONFIG
from capture.station.domain.folder import make_station
from capture.station.domain.verdict import Cause, Decision
from capture.station.run.diagnosis import diagnose_station
from capture.station.run.events import PartAnnounced
from classify.base.errors import InputError
from tests.capture.station.production import collected, configure


@pytest.fixture
def line(tmp_path: Path) -> Path:
    """A station that has collected a part."""
    folder = tmp_path / "line"
    make_station(folder)
    configure(folder)
    collected(folder, 1)
    return folder


def contents(folder: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in (folder / "parts").glob("*/*.ome.tif")}


def test_a_station_with_sets_and_another_name_does_not_start(line: Path) -> None:
    before = contents(line)
    config = line / CONFIG
    config.write_text(config.read_text().replace('name = "line"', 'name = "line-2"'))
    with pytest.raises(InputError, match=r"name = .*move .*parts"):
        collected(line, 1)
    assert contents(line) == before
    found = {check.name: check.status for check in diagnose_station(line)}
    assert found["results"] == "fault"
    shutil.move(line / "parts", line / "parts of line")
    assert [type(each) for each in collected(line, 1)].count(PartAnnounced) == 1


def test_a_set_file_that_exists_is_an_error_and_stays(line: Path) -> None:
    [[first, pixels]] = contents(line).items()
    second = first.with_name("part-000002.ome.tif")
    second.write_bytes(pixels)
    announced = [each.result for each in collected(line, 2) if isinstance(each, PartAnnounced)]
    assert [each.verdict.decision for each in announced] == [Decision.ERROR, Decision.UNKNOWN]
    assert announced[0].verdict.causes == (Cause.STORAGE,)
    assert announced[0].set_file is None
    assert second.read_bytes() == pixels
