import threading
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from unittest.mock import Mock

import pytest

from capture.base.utc_time import utc_text
from capture.station.domain.config import Retention
from capture.station.domain.verdict import Decision
from capture.station.results.removals import passed_sets, record_removals
from capture.station.results.store import ResultStore, open_store
from capture.station.run import retention
from capture.station.run.retention import is_sample, remove_old_sets, retention_in_background
from classify.base.errors import InputError
from tests.capture.station.results.parts import inspect
from tests.capture.station.stations import make_days
from tests.waiting import until_so

NOW = datetime(2026, 11, 22, 12, tzinfo=UTC)
NO_SAMPLE = Retention(pass_every=1_000_000, pass_days=7.0)


@pytest.fixture
def store(tmp_path: Path) -> Iterator[ResultStore]:
    with open_store(str(tmp_path / "results.sqlite"), "line-1", create=True) as store:
        yield store


def make_part(store: ResultStore, folder: Path, decision: Decision, days_ago: float) -> Path:
    utc = utc_text(NOW - timedelta(days=days_ago), timespec="milliseconds")
    number = sum(1 for _ in store.parts()) + 1
    path = folder / "parts" / utc[:10] / f"part-{number:06d}.ome.tif"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("a set")
    inspect(store, decision, triggered_utc=utc, set_file=str(path.relative_to(folder)))
    return path


def test_only_old_sets_of_parts_that_passed_are_removed(store: ResultStore, tmp_path: Path) -> None:
    kept = [make_part(store, tmp_path, decision, 30) for decision in list(Decision)[1:]]
    kept += [make_part(store, tmp_path, Decision.PASS, 6.9)]
    old = [make_part(store, tmp_path, Decision.PASS, days) for days in (7.1, 400)]
    make_days(tmp_path, NOW)
    assert remove_old_sets(tmp_path, store, NO_SAMPLE, NOW) == 2
    assert [path.exists() for path in kept] == [True] * 4
    assert [path.exists() for path in old] == [False] * 2
    assert not old[1].parent.exists()
    removed = [entry.result.part_id for entry in store.parts() if entry.set_removed_utc]
    assert removed == ["part-000005", "part-000006"]
    assert remove_old_sets(tmp_path, store, NO_SAMPLE, NOW) == 0


@pytest.mark.parametrize("decision", [Decision.PASS, Decision.FAIL])
def test_a_part_that_a_person_judged_keeps_its_set(
    store: ResultStore, tmp_path: Path, decision: Decision
) -> None:
    path = make_part(store, tmp_path, Decision.PASS, 30)
    utc = utc_text(NOW, timespec="milliseconds")
    store.override("part-000001", decision=decision, by="Kim", reason="looked at it", utc=utc)
    make_days(tmp_path, NOW)
    assert remove_old_sets(tmp_path, store, NO_SAMPLE, NOW) == 0
    assert path.exists()


@pytest.mark.parametrize("days_ahead", [8, 31, 3650])
def test_a_clock_that_is_set_ahead_makes_no_sets_old(
    store: ResultStore, tmp_path: Path, days_ahead: int
) -> None:
    paths = [make_part(store, tmp_path, Decision.PASS, days_ago) for days_ago in (2, 1, 0)]
    ahead = NOW + timedelta(days=days_ahead)
    assert remove_old_sets(tmp_path, store, NO_SAMPLE, ahead) == 0
    paths.append(make_part(store, tmp_path, Decision.PASS, -days_ahead))
    assert remove_old_sets(tmp_path, store, NO_SAMPLE, ahead) == 0
    assert all(path.exists() for path in paths)
    # Days with parts make them old.
    for day in range(1, 8):
        make_part(store, tmp_path, Decision.PASS, -days_ahead - day)
    assert remove_old_sets(tmp_path, store, NO_SAMPLE, ahead + timedelta(days=7.5)) == 4
    assert not any(path.exists() for path in paths)


def test_a_removal_interrupted_after_its_row_is_completed(
    store: ResultStore, tmp_path: Path
) -> None:
    path = make_part(store, tmp_path, Decision.PASS, 30)
    removed = dict(passed_sets(store, "9"))
    for _ in range(2):  # once more after a lost connection
        record_removals(store, removed, utc_text(NOW, timespec="milliseconds"))
    assert path.exists()
    # The clock was set back in between.
    assert remove_old_sets(tmp_path, store, NO_SAMPLE, NOW - timedelta(hours=1)) == 1
    assert not path.exists()


@pytest.mark.parametrize("set_file", ["parts/../station.toml", "station.toml", "/etc/passwd"])
def test_no_row_can_have_a_file_outside_the_parts_removed(
    store: ResultStore, tmp_path: Path, set_file: str
) -> None:
    (tmp_path / "station.toml").touch()
    inspect(store, triggered_utc="2020-01-01T00:00:00.000Z", set_file=set_file)
    with pytest.raises(InputError, match="not in parts/"):
        remove_old_sets(tmp_path, store, NO_SAMPLE, NOW)
    assert (tmp_path / "station.toml").exists()
    assert [entry.set_removed_utc for entry in store.parts()] == [None]


def test_the_sample_is_the_same_each_time_and_as_large_as_asked() -> None:
    ids = [f"part-{number:06d}" for number in range(20_000)]
    sample = [part_id for part_id in ids if is_sample("line-1", part_id, 20)]
    assert sample == [part_id for part_id in ids if is_sample("line-1", part_id, 20)]
    assert 900 < len(sample) < 1100  # 1000 within 3 standard deviations of 31
    assert all(is_sample("line-1", part_id, 1) for part_id in ids[:50])


def test_old_sets_go_while_the_station_runs(store: ResultStore, tmp_path: Path) -> None:
    path = make_part(store, tmp_path, Decision.PASS, 2000)
    make_days(tmp_path, datetime.now(UTC))
    with retention_in_background(tmp_path, store, NO_SAMPLE, print):
        until_so(lambda: not path.exists())
    [entry] = store.parts()
    assert entry.set_removed_utc[:10] <= datetime.now(UTC).date().isoformat()


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (None, "../elsewhere"),
        (OSError(5, "Input/output error"), "[Errno 5] Input/output error"),
    ],
)
def test_what_fails_is_a_warning(
    store: ResultStore,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    error: OSError | None,
    said: str,
) -> None:
    warnings, warned = list[str](), threading.Event()
    if error is not None:
        monkeypatch.setattr(retention, "remove_old_sets", Mock(side_effect=error))

    def warn(text: str) -> None:
        warnings.append(text)
        warned.set()

    inspect(store, triggered_utc="2020-01-01T00:00:00.000Z", set_file="../elsewhere")
    with retention_in_background(tmp_path, store, NO_SAMPLE, warn):
        assert warned.wait(60)
    assert warnings[0].startswith(f"old sets are not removed: {said}")
