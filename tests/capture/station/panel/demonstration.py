"""A taught station on the simulated rig, with parts of every verdict for its pages."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from capture.station.domain.config import CONFIG
from capture.station.domain.users import Role
from capture.station.domain.verdict import Cause, Decision
from capture.station.judge.gauge import GaugeReport, Presentation
from rig import RigConfig
from tests.capture.station.panel.panels import PASSWORD, ServedPanel, real_panel
from tests.capture.station.production import taught_station
from tests.capture.station.teaching_sets import SIDE_PX

# Of the parts below the simulated camera: enough of each kind among a dozen.
_SHARES = {"share_other": 0.2, "share_defective": 0.4}
# More than these without a part that failed say that something is wrong.
_MOST_PARTS = 40


@contextmanager
def demonstration(
    folder: Path, least_parts: int = 6, side_px: int = SIDE_PX
) -> Iterator[ServedPanel]:
    """Serve a station with users, parts that passed, failed and were overridden, and a job."""
    taught_station(folder, side_px)
    config = (folder / CONFIG).read_text(encoding="utf-8").splitlines()
    lines = (
        f"{name} = {_SHARES[name]}" if (name := line.split(" ")[0]) in _SHARES else line
        for line in config
    )
    (folder / CONFIG).write_text("\n".join(lines), encoding="utf-8")
    rig_config = RigConfig().with_changes(camera={"width_px": side_px, "height_px": side_px})
    with real_panel(folder, rig_config) as served:
        served.until_ready()
        for role in Role:
            served.panel.users.put(role, role, PASSWORD)
        engineer = served.client(Role.ENGINEER)
        made: list[str] = []
        while len(made) < least_parts or len(verdicts(served)) < 2 or not failed(served):
            assert len(made) < least_parts + _MOST_PARTS, verdicts(served)
            made += served.parts(1, engineer)
        given = {"decision": "PASS", "reason": "a hair, blown away"}
        overridden = failed(served)[:2][-1]
        assert engineer.post(f"/api/v1/parts/{overridden}/override", given).status == 200
        _study(served)
        job = engineer.job(f"/api/v1/recipes/{served.panel.folder.config.recipe}/challenge")
        assert job["status"] == "done", job
        yield served


def verdicts(served: ServedPanel) -> set[Decision]:
    """The verdicts of the station that there are."""
    return {each.result.verdict.decision for each in served.panel.results.store.parts()}


def failed(served: ServedPanel) -> list[str]:
    """Parts that the station did not pass, those with defects alone first."""
    results = [each.result for each in served.panel.results.store.parts()]
    rejected = [each for each in results if each.verdict.decision is not Decision.PASS]
    return [
        each.part_id
        for each in sorted(
            rejected,
            key=lambda each: (each.verdict.causes != (Cause.DEFECT,), -len(each.defects)),
        )
    ]


def _study(served: ServedPanel) -> None:
    """Keep the report of a gauge study, as `ps4rig station gauge` does."""
    shown = [
        Presentation(f"K{part:02d}", part % 2 == 0, decision, "a scratch")
        for part in range(20)
        for decision in [Decision.FAIL if part % 2 or part == 6 else Decision.PASS] * 3
    ]
    folder = served.panel.folder
    report = GaugeReport.of(shown, folder.config.recipe, None, simulated=True)
    report.write(folder.recipe_files().gauge)
