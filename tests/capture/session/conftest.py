"""A small session on the simulated rig, with scripted answers."""

from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path

import pytest

from capture.session.events import Answer, Ask, Event, Question, without_questions
from capture.session.folder import SessionFolder, make_session, session_folder
from capture.session.runner import run_session
from rig import RigConfig

PLAN = """
name = "stones"
operator = "J. Wu"
orientations_deg = [0, 40]

[[specimen]]
id = "rock-1"
label = "rock"
surface = "rock"
note = "chipped"

[[specimen]]
id = "sand-1"
surface = "sand"
"""


class Script:
    """Answers questions from a list, then GO, and keeps questions and events."""

    def __init__(self, answers: Iterable[Answer]) -> None:
        self._answers = iter(answers)
        self.questions: list[Question] = []
        self.events: list[Event] = []

    def ask(self, question: Question) -> Answer:
        self.questions.append(question)
        return next(self._answers, Answer.GO)


@pytest.fixture(scope="session")
def config() -> RigConfig:
    return RigConfig().with_changes(camera={"width_px": 128, "height_px": 128})


@pytest.fixture(scope="session")
def captured_session(
    tmp_path_factory: pytest.TempPathFactory, config: RigConfig
) -> Callable[[str], Path]:
    """Capture all sets of a plan once; return the folder, which is not to be changed."""

    @cache
    def capture(text: str) -> Path:
        plan = tmp_path_factory.mktemp("session") / "plan.toml"
        plan.write_text(text)
        folder = make_session(plan)
        with session_folder(folder) as session:
            run_session(session, config, without_questions, lambda _: None)
        return folder

    return capture


@pytest.fixture
def plan_file(tmp_path: Path) -> Path:
    path = tmp_path / "stones.toml"
    path.write_text(PLAN, encoding="utf-8")
    return path


@pytest.fixture
def session(plan_file: Path) -> Path:
    return make_session(plan_file)


Run = Callable[..., Script]


@pytest.fixture
def run(session: Path, config: RigConfig) -> Run:
    """Run the session with some answers; return the script with its questions and events."""

    def run_with(*answers: Answer, ask: Ask | None = None, rig: RigConfig = config) -> Script:
        script = Script(answers)
        with session_folder(session) as folder:
            run_session(folder, rig, ask or script.ask, script.events.append)
        return script

    return run_with


@pytest.fixture
def folder(session: Path) -> Callable[[], SessionFolder]:
    """Read the session as it is on disk."""
    return lambda: SessionFolder(session)
