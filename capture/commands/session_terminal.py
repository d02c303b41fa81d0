"""A session on the terminal: its questions, a line for each set, and progress."""

from __future__ import annotations

import sys
import time
from typing import TYPE_CHECKING, Self

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from capture.base.console import complain, out
from capture.session import events
from capture.session.events import Answer

if TYPE_CHECKING:
    from capture.session.folder import SessionFolder
    from capture.session.journal import SetEntry
    from capture.session.live_view import LiveView

_ANSWERS = {"": Answer.GO, "r": Answer.REPEAT, "s": Answer.SKIP, "q": Answer.STOP}


def left_out_text(folder: SessionFolder) -> str:
    """Say how many sets were left out, and how to capture them."""
    return (
        f"{len(folder.left_out())} left out; ps4rig session resume {folder.path} --left-out asks "
        "for them again"
    )


def confirmed(question: str) -> bool:
    """Ask a yes-no question on the terminal; an empty answer, or the end of input, is no."""
    try:
        return _line(f"{question} [y/N] ").lower() in ("y", "yes")
    except EOFError:
        return False


class SessionTerminal:
    """Subscribes to the events of a session, and answers its questions from the keyboard.

    Every event that is shown also goes into the log of the session.
    """

    def __init__(
        self, folder: SessionFolder, missing: int, *, quiet: bool, view: LiveView | None = None
    ) -> None:
        self._folder, self._quiet, self._view = folder, quiet, view
        self._started_s = time.monotonic()
        console = Console(stderr=True)
        self._bar = Progress(
            TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(),
            TimeRemainingColumn(), console=console, transient=True,
            disable=not console.is_terminal,
        )  # fmt: skip
        total = len(folder.plan)
        self._task = self._bar.add_task("sets", total=total, completed=total - missing)

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()

    def listen(self, event: events.Event) -> None:
        """Show an event, and log it."""
        match event:
            case events.SetCaptured(entry):
                self._say(line_of(entry))
                if self._view is not None:
                    self._view.show_captured(entry)
                self._bar.advance(self._task)
            case events.SetAdopted(entry):
                self._say(f"{entry.file}: found from an earlier run, entered into the journal")
                self._bar.advance(self._task)
            case events.SetDamaged(planned, reason):
                self._say(
                    f"{planned}: its file is damaged: {reason}; it is in the folder replaced, and "
                    "the set is captured again"
                )
            case events.SetFailed(planned, reason):
                self._folder.log(f"{planned}: {reason}")
                complain(f"{planned}: {reason}")
            case events.RigCompared(checks):
                for check in checks:
                    advice = "" if check.status == "ok" else f": {check.advice}"
                    self._say(f"calibration: {check.seen}{advice}")
            case events.RigChanged(changes):
                for change in changes:
                    self._say(f"the rig differs from the last run: {change}")
            case events.SessionFinished(finish, reason, captured, missing, left_out):
                if reason is not None:
                    self._folder.log(reason)
                self._say(
                    f"{finish}: {captured} sets captured in this run, {missing} missing"
                    + (f", {left_out_text(self._folder)}" if left_out else "")
                )

    def ask(self, question: events.Question) -> Answer:
        """Ask until there is an answer; no more input means stop."""
        if isinstance(question, events.PlaceSpecimen) and self._view is not None:
            with self._view.placing(question):
                return self._answer(question)
        return self._answer(question)

    def _answer(self, question: events.Question) -> Answer:
        match question:
            case events.PlaceSpecimen(planned):
                text = (
                    f"{planned.specimen}, turn to {planned.orientation_deg:g} degrees, then Enter; "
                    "r repeats the last, s leaves it out, q stops: "
                )
            case events.PlaceSheet(cause):
                text = (
                    ("" if cause is None else f"{cause}. Lay it down anew, or stop: ")
                    + "put a white matt sheet under the camera, then Enter; s goes on without "
                    "comparing the rig with its calibration, q stops: "
                )
            case events.DecideFailure(_, _, lost_rig):
                text = (
                    "connect the rig, then r tries again; s leaves it out, q stops: "
                    if lost_rig
                    else "r tries again, Enter goes on without it, s leaves it out, q stops: "
                )
            case events.DecideWarnings(planned, warnings):
                text = (
                    f"{planned}: {'; '.join(warnings)}. Enter keeps it, r repeats, s leaves it "
                    "out, q stops: "
                )
        while True:
            self._bar.stop()
            try:
                answer = _ANSWERS.get(_line(text).strip().lower())
            except EOFError:
                answer = Answer.STOP
            self._bar.start()
            if isinstance(question, events.DecideFailure) and answer is Answer.GO:
                answer = None if question.lost_rig else Answer.LEAVE
            if answer is not None:
                return answer

    def _say(self, line: str) -> None:
        self._folder.log(line)
        if not self._quiet:
            out.print(line)


def line_of(entry: SetEntry) -> str:
    """Return the line of the terminal for a captured set."""
    measures = entry.measures
    if measures is None:
        return f"{entry.file}: captured"
    levels = " ".join(f"{level:.1%}" for level in measures.led_levels)
    phrases = [
        f"{entry.file}: levels {levels}",
        f"saturated {measures.saturated:.1%}",
        f"shadow {measures.shadowed:.1%}",
    ]
    if measures.estimated_deg is not None:
        phrases.append(f"at {measures.estimated_deg:z.1f} degrees")
    if measures.blur_px is not None:
        phrases.append(f"focus {-measures.blur_px:+z.1f} px")
    return ", ".join([*phrases, *measures.warnings])


def _line(prompt: str) -> str:
    """Read a line from the keyboard; the prompt goes to stderr, so that stdout holds results."""
    print(prompt, end="", file=sys.stderr, flush=True)
    line = sys.stdin.readline()
    if not line:
        raise EOFError
    return line.rstrip("\n")
