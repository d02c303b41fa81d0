"""The page of the station: keys of its files, states, events, calls and registers."""

from capture.station.domain.config import StationConfig
from capture.station.domain.recipe import Recipe
from capture.station.run.states import TRANSITIONS, State

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
            *map(_changes, State),
            "",
            "## Events",
            "",
            "One line of JSON each, as `event`, with the fields in brackets.",
            "",
            *event_lines(),
            "",
            "## Calls of the HTTP API",
            "",
            "Below `/api/v1`; in brackets query or fields, which `/api` explains.",
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


def _changes(state: State) -> str:
    changes = [f"{change}: {new}" for (old, change), new in TRANSITIONS.items() if old is state]
    return f"- `{state}` {'; '.join(changes)}"
