"""The page of the station: keys of its files, states, events, calls and registers."""

from capture.station.domain.config import StationConfig
from capture.station.domain.recipe import Recipe
from capture.station.panel.guard import V1
from capture.station.run.events import TRANSITIONS, State

from .calls import call_lines, event_lines
from .keys import sections
from .registers import cause_lines, register_lines


def station_page() -> str:
    """Return the page as Markdown."""
    return "\n".join(
        [
            "# Station",
            "",
            "## `station.toml`",
            "",
            *sections(StationConfig),
            "",
            "## `recipes/NAME.toml`",
            "",
            *sections(Recipe),
            "",
            "## States",
            "",
            *_changes(),
            "",
            "## Events",
            "",
            "One line of JSON each, as `event`, with `utc` and the fields in brackets;",
            "`part` and `recovered` have the columns of `results`, too.",
            "",
            *event_lines(),
            "",
            "## Calls of the HTTP API",
            "",
            f"Below `{V1}`; the page `/api` explains queries, fields and answers,",
            "`openapi.json` does so for programs. A role may use the calls of those before it.",
            "",
            *call_lines(),
            "",
            "## Causes",
            "",
            "The code for a PLC, the name, the verdict; the gravest first.",
            "",
            *cause_lines(),
            "",
            "## Registers of the PLC",
            *register_lines(),
        ]
    )


def _changes() -> list[str]:
    """Return a line for each change of the state, with the states before and after it."""
    states: dict[tuple[str, State], list[str]] = {}
    for (old, change), new in TRANSITIONS.items():
        states.setdefault((change, new), []).append(f"`{old}`")
    return [
        f"- {change}: {'any state' if len(old) == len(State) else ', '.join(old)} to `{new}`"
        for (change, new), old in states.items()
    ]
