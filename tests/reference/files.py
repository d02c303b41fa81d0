"""The page of files and exit statuses."""

from capture.base.interrupts import INTERRUPTED_STATUS
from capture.base.process_end import BROKEN_PIPE_STATUS, CRASH_STATUS
from capture.calibration.ps4cal import PartRecord
from capture.commands.solve import FOLDER, FORMATS
from capture.session.folder import COLUMNS
from capture.session.plan import SessionPlan
from capture.sets.metadata import SetMetadata
from classify.base.errors import InputError
from rig.errors import HardwareError

from .keys import fields, sections

EXIT_STATUSES = {
    0: "done",
    1: "the answer is no: a rejected set, a part that did not pass, a refused calibration step, a "
    "fault that a doctor found",
    InputError.exit_status: "usage error or bad input",
    HardwareError.exit_status: "hardware error",
    CRASH_STATUS: "unforeseen error; the line on stderr names a log file",
    INTERRUPTED_STATUS: "interrupted",
    BROKEN_PIPE_STATUS: "the reader of the output went away; the work was finished",
}


def files_page() -> str:
    """Return the page as Markdown."""
    return "\n".join(
        [
            "# Files and exit statuses",
            "",
            "## Exit statuses",
            "",
            *(f"- `{status}` {meaning}" for status, meaning in EXIT_STATUSES.items()),
            "",
            "## `ps4rig export SET OUT`",
            "",
            *(f"- `NAME{suffix}` {form.content}" for suffix, form in FORMATS.items()),
            f"- a folder: {FOLDER}",
            "",
            "## Plan of a session",
            "",
            *sections(SessionPlan),
            "",
            "## `sets.csv`",
            "",
            ", ".join(f"`{column}`" for column in COLUMNS)
            + "; `level_led_0` ..., and a column of each property.",
            "",
            "## JSON of a captured set",
            "",
            *fields(SetMetadata),
            "- `sha256` over all other fields, as ASCII JSON with sorted keys and no blanks",
            "",
            "## Record of a part of a calibration",
            "",
            *fields(PartRecord),
        ]
    )
