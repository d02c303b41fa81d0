"""The page during the placement of a specimen: live images, outline, present orientation."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from capture.session.events import Answer, PlaceSpecimen, Question, SetCaptured
from capture.session.folder import SessionFolder, session_folder
from capture.session.live_view import LiveView, PlacementGuide
from capture.session.runner import run_session
from rig import RigConfig, open_rig
from rig.fresh_frame import fresh_frame
from tests.waiting import until_so

from .conftest import Run

Page = dict[str, Any]


class Operator:
    """Looks at the page at each placement until it shows what is wanted, and then says GO."""

    def __init__(self, folder: SessionFolder, wanted: Callable[[Page], object]) -> None:
        self.view = LiveView(folder)
        self._wanted = wanted
        self.pages: list[Page] = []

    def ask(self, question: Question) -> Answer:
        if isinstance(question, PlaceSpecimen):
            with self.view.placing(question):
                until_so(lambda: self._wanted(self.view.preview.state()))
                self.pages.append(self.view.preview.state())
        return Answer.GO

    def listen(self, event: object) -> None:
        if isinstance(event, SetCaptured):
            self.view.show_captured(event.entry)


def is_complete(page: Page) -> bool:
    has_images = page["lights"] and all(light["sequence"] is not None for light in page["lights"])
    return bool(has_images and (page["overlay"] is None or page["found"]))


def test_each_placement_shows_its_outline_and_orientation(session: Path, config: RigConfig) -> None:
    # Sand alone: rock has no direction.
    plan = session / "plan.toml"
    head, _, sand = plan.read_text().split("[[specimen]]")
    plan.write_text(f"{head}[[specimen]]{sand}")
    with session_folder(session) as folder:
        operator = Operator(folder, is_complete)
        run_session(folder, config, operator.ask, operator.listen)
        assert folder.missing() == []
    first, second = operator.pages
    assert first["guide"] == "sand-1: first placement"
    assert first["overlay"] is None
    assert second["guide"] == "sand-1: turn to 40 degrees"
    assert second["overlay"] == 2
    # The simulated rig has turned it already.
    assert second["found"].endswith(" degrees: good")
    assert float(second["found"].split()[2]) == pytest.approx(40.0, abs=2.0)
    assert second["captured"] == "sets/sand-1-0-1.ome.tif: captured"
    last = operator.view.preview.state()
    assert last["captured"].endswith(" degrees, 40 were asked")
    assert last["found"] is None


def test_a_rig_that_fails_is_shown_and_the_session_goes_on(
    session: Path, config: RigConfig
) -> None:
    gone = {"frames": [{"kind": "gone", "when": {"from_s": 0.5}}]}
    broken = config.with_changes(simulation={"faults": gone})
    with session_folder(session) as folder, open_rig(broken) as rig:
        operator = Operator(folder, lambda page: page["error"])
        question = PlaceSpecimen(next(folder.plan.sets()), lambda: rig)
        assert operator.ask(question) is Answer.GO
    error = operator.pages[0]["error"]
    assert "no frame" in error or "gone" in error


def test_without_software_switching_the_page_says_why_it_has_no_images(
    session: Path, config: RigConfig
) -> None:
    strobe = config.with_changes(lights={"synchronisation": "strobe"})
    with session_folder(session) as folder, open_rig(strobe) as rig:
        operator = Operator(folder, lambda page: page["error"])
        operator.ask(PlaceSpecimen(next(folder.plan.sets()), lambda: rig))
    assert "live images need lights.synchronisation" in operator.pages[0]["error"]


def test_the_guide_says_which_way_to_turn(run: Run, session: Path, config: RigConfig) -> None:
    run()
    there = {"surface": "sand", "rotate_deg": 40.0, "shift_px": (50.0, 9.0)}
    with open_rig(config.with_changes(simulation={"placement": there})) as rig:
        frames = [fresh_frame(rig, light) for light in range(4)]
        for asked_deg, way in ((40.0, "good"), (60.0, "anticlockwise"), (-150.0, " clockwise")):
            guide = PlacementGuide.of(session / "sets" / "sand-1-0-1.ome.tif", asked_deg)
            said = guide.orientation_text(rig.lighting, frames)
            assert said.endswith(way)
            # -150 degrees is 30 to a texture that looks alike after half a turn.
            now_deg = float(said.split()[2])
            assert (now_deg - 40.0 + 90.0) % 180.0 - 90.0 == pytest.approx(0.0, abs=2.0)
