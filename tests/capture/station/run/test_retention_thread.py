import threading
from datetime import UTC, datetime
from pathlib import Path
from unittest.mock import Mock

import pytest

from capture.station.domain.config import Retention
from capture.station.results.store import open_store
from capture.station.run import retention
from capture.station.run.retention import retention_in_background
from tests.capture.station.days_with_parts import make_days
from tests.capture.station.results.parts import inspect
from tests.waiting import until_so


def test_old_sets_go_while_the_station_runs(tmp_path: Path) -> None:
    path = tmp_path / "parts" / "2020-01-01" / "a.ome.tif"
    path.parent.mkdir(parents=True)
    path.write_text("a set")
    make_days(tmp_path, datetime.now(UTC))
    with open_store(str(tmp_path / "results.sqlite"), "line-1", create=True) as store:
        inspect(
            store, triggered_utc="2020-01-01T00:00:00.000Z", set_file="parts/2020-01-01/a.ome.tif"
        )
        retention = Retention(pass_every=1_000_000, pass_days=1.0)
        with retention_in_background(tmp_path, store, retention, print):
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
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: OSError | None, said: str
) -> None:
    warnings, warned = list[str](), threading.Event()
    if error is not None:
        monkeypatch.setattr(retention, "remove_old_sets", Mock(side_effect=error))

    def warn(text: str) -> None:
        warnings.append(text)
        warned.set()

    with open_store(str(tmp_path / "results.sqlite"), "line-1", create=True) as store:
        inspect(store, triggered_utc="2020-01-01T00:00:00.000Z", set_file="../elsewhere")
        with retention_in_background(tmp_path, store, Retention(pass_every=1_000_000), warn):
            assert warned.wait(60)
    assert warnings[0].startswith(f"old sets are not removed: {said}")
