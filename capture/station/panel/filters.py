"""Which parts a page or an API call is about: the filters of a query."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from typing import Self
from urllib.parse import urlencode

from capture.station.domain.verdict import Decision
from capture.station.results.history import Selection
from capture.station.results.statistics import Choices
from capture.station.results.utc import utc_bound
from classify.base.errors import InputError

from .routes import Call

FILTERS = {
    "since": "parts triggered then or later: 2026-11-22 or 2026-11-22T14:30, UTC",
    "until": "parts triggered then or earlier; a date or a minute counts to its end",
    "verdict": "the verdict that holds, after overrides: PASS, FAIL, UNKNOWN or ERROR",
    "part": "part of the identity, in any case",
    "class": "the texture that was found",
    "recipe": "name of the recipe",
    "simulated": "true: also parts of a simulated rig; only: these alone; by default production",
}
OF_ONE_PART = ("verdict", "part")
"""Filters that statistics do not have."""
_TIMES = {"since", "until"}
_SIMULATED = {"true": None, "false": False, "only": True}


def selection_of(query: Mapping[str, str]) -> Selection:
    """Return the selection that a query describes; an empty value selects all."""
    since, until, verdict = (query.get(name) or None for name in ("since", "until", "verdict"))
    simulated = query.get("simulated") or "false"
    if verdict is not None and verdict.upper() not in Decision.__members__:
        raise InputError(f"verdict = {verdict[:20]!r}: give PASS, FAIL, UNKNOWN or ERROR")
    if simulated not in _SIMULATED:
        raise InputError(f"simulated = {simulated[:20]!r}: give true, false or only")
    return Selection(
        since_utc=None if since is None else utc_bound("since", since),
        until_utc=None if until is None else utc_bound("until", until, is_end=True),
        decision=None if verdict is None else Decision(verdict.upper()),
        label=query.get("class") or None,
        recipe=query.get("recipe") or None,
        simulated=_SIMULATED[simulated],
        part_of_id=query.get("part") or None,
    )


@dataclass(frozen=True)
class FilterForm:
    """Values and choices of the form."""

    # Filters of the query, with times in UTC; on a simulated rig simulated parts unless the query
    # says otherwise.
    values: Mapping[str, str]
    choices: Choices

    @classmethod
    def of(cls, call: Call, choices: Choices) -> Self:
        """Return the form of a page."""
        given = {name: value for name in FILTERS if (value := call.query.get(name))}
        for name in _TIMES & given.keys():
            with suppress(InputError):  # of which `selection_of` tells
                given[name] = utc_bound(name, given[name], is_end=name == "until", is_local=True)
        default = "only" if call.panel.live.snapshot().simulated else "false"
        return cls({"simulated": default} | given, choices)

    @property
    def query(self) -> str:
        """The filters as the query of an address."""
        return urlencode(self.values)

    @property
    def statistics_query(self) -> str:
        """The filters that statistics have, of production or of a simulated rig."""
        values = {name: value for name, value in self.values.items() if name not in OF_ONE_PART}
        if values["simulated"] == "true":
            values["simulated"] = "false"
        return urlencode(values)

    def value(self, name: str) -> str:
        """Return the value of a filter; empty if it is not given."""
        return self.values.get(name, "")

    def time(self, name: str) -> str:
        """Return a time as a field for times has it, on the station's clock."""
        try:
            return f"{datetime.fromisoformat(self.value(name)).astimezone():%Y-%m-%dT%H:%M}"
        except ValueError:
            return ""

    def names(self, name: str) -> list[str]:
        """Return the classes or recipes of all results, and the one that is asked for."""
        known = self.choices.labels if name == "class" else self.choices.recipes
        return list(dict.fromkeys(filter(None, (*known, self.value(name)))))
