"""The form that selects parts, on the pages of history and statistics."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self
from urllib.parse import urlencode

from capture.station.results.statistics import Choices

from .filters import FILTERS, OF_ONE_PART
from .routes import Call


@dataclass(frozen=True)
class FilterForm:
    """Values and choices of the form."""

    # Filters of the query; on a simulated rig simulated parts unless the query says otherwise.
    values: Mapping[str, str]
    choices: Choices

    @classmethod
    def of(cls, call: Call, choices: Choices) -> Self:
        """Return the form of a page."""
        given = {name: value for name in FILTERS if (value := call.query.get(name))}
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
        """Return a time as a field for times has it; a date alone is its first or last minute."""
        text = self.value(name)
        if len(text) == len("2026-11-22"):
            text += "T00:00" if name == "since" else "T23:59"
        return text[: len("2026-11-22T17:08")]
