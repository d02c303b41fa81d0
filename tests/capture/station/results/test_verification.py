import shutil
import sqlite3
from collections.abc import Iterator
from pathlib import Path

import pytest

from capture import CapturedSet
from capture.station.domain.config import example_config
from capture.station.domain.folder import StationFolder
from capture.station.domain.verdict import Decision
from capture.station.results.removals import record_removals
from capture.station.results.store import ResultStore, open_store
from capture.station.results.verification import verify_station
from classify.base.errors import InputError, Ps4rigError

from .parts import UTC, begin, inspect

SET = Path(__file__).parents[3] / "data" / "sets"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "station.toml").write_text(example_config("line-1"))
    return tmp_path


@pytest.fixture
def store(folder: Path) -> Iterator[ResultStore]:
    with open_store(str(folder / "results.sqlite"), "line-1", create=True) as store:
        yield store


@pytest.fixture
def kept(folder: Path, store: ResultStore) -> Path:
    """The set file of the one part of the station."""
    path = folder / "parts" / "2026-11-22" / "A.ome.tif"
    path.parent.mkdir(parents=True)
    shutil.copy(next(iter(sorted(SET.glob("*.ome.tif")))), path)
    sha256 = CapturedSet.load(path).metadata.pixels_sha256
    inspect(store, part_id="A", set_file=str(path.relative_to(folder)), set_sha256=sha256)
    return path


def states(folder: Path) -> dict[str, str]:
    findings = [each for each in verify_station(folder) if each.state != "good"]
    return {str(each.path.relative_to(folder)): each.state for each in findings}


def test_a_missing_set_is_found_unless_it_was_removed(
    folder: Path, store: ResultStore, kept: Path
) -> None:
    kept.unlink()
    name = str(kept.relative_to(folder))
    assert states(folder) == {name: "missing"}
    record_removals(store, {"A": name}, UTC)
    assert states(folder) == {}


def test_a_set_of_another_part_in_its_place_is_found(
    folder: Path, store: ResultStore, kept: Path
) -> None:
    name = str(kept.relative_to(folder))
    inspect(store, part_id="B", set_file=name, set_sha256="0" * 64)
    assert states(folder) == {name: "altered"}


def test_a_set_without_a_result_is_found(folder: Path, kept: Path) -> None:
    shutil.copy(kept, kept.with_name("B.ome.tif"))
    assert states(folder) == {"parts/2026-11-22/B.ome.tif": "not in results"}


def test_a_part_without_a_result_is_found(folder: Path, store: ResultStore) -> None:
    begin(store)
    [finding] = verify_station(folder)
    assert finding.details.startswith("parts without a result: 1, the first part-000001")


def test_rows_that_somebody_took_away_are_found(folder: Path, store: ResultStore) -> None:
    for _ in range(3):
        inspect(store)
    with sqlite3.connect(folder / "results.sqlite") as other:
        for table in ("results", "begun_parts"):
            other.execute(f"DROP TRIGGER {table}_no_delete")
            other.execute(f"DELETE FROM {table} WHERE number = 2")
    chain, numbers = verify_station(folder)
    assert "links 2 to 2 of the chain of hashes" in chain.details
    assert "1 of 3 numbers of parts are missing" in numbers.details


@pytest.mark.parametrize(
    "change", ["decision = 'PASS'", "causes = 'none'", "causes = '[\"a cause\"]'"]
)
def test_a_row_that_no_result_has_is_named(
    folder: Path, store: ResultStore, kept: Path, change: str
) -> None:
    inspect(store, Decision.UNKNOWN)
    with sqlite3.connect(folder / "results.sqlite") as other:
        other.execute("DROP TRIGGER results_no_update")
        other.execute(f"UPDATE results SET {change} WHERE number = 2")
    assert kept.is_file()
    details = [finding.details for finding in verify_station(folder)]
    assert "its results cannot be read: " in details[-1]
    with pytest.raises(Ps4rigError, match="somebody altered the results"):
        [*store.parts()]
    if "'none'" not in change:
        assert "link 2 of the chain of hashes, in results, part part-000002, was" in details[0]


def test_a_head_that_was_kept_elsewhere_must_still_be_in_the_chain(
    folder: Path, store: ResultStore
) -> None:
    inspect(store)
    head = store.chain_head().chain_sha256
    assert [finding.state for finding in verify_station(folder, head)] == ["good"]
    assert [finding.state for finding in verify_station(folder, "0" * 64)] == ["altered"]


def test_numbers_do_not_begin_anew_beside_sets_of_a_lost_database(
    folder: Path, store: ResultStore, kept: Path
) -> None:
    assert kept.is_file()
    store.close()
    (folder / "results.sqlite").unlink()
    station = StationFolder(folder)
    assert station.has_sets()
    with pytest.raises(InputError, match="restore a backup"):
        open_store(str(folder / "results.sqlite"), "line-1", create=not station.has_sets())
