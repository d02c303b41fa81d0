"""Filters of a query, which select parts for a page or an API call."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Annotated, Literal, Self
from urllib.parse import urlencode

from pydantic import BeforeValidator, Field, WithJsonSchema

from capture.station.domain.verdict import Decision
from capture.station.results.history import Selection, utc_bound
from capture.station.results.statistics import known_names
from classify.base.errors import InputError
from classify.base.models import Record, validated

from .guard import Call

_TIME = WithJsonSchema(
    {
        "anyOf": [
            {"type": "string", "format": "date"},
            {"type": "string", "format": "date-time"},
            {"type": "string", "maxLength": 0},
        ]
    }
)
_SIMULATED = {"": False, "true": None, "false": False, "only": True}


class StatisticsFilters(Record):
    """Filters of statistics; an empty value selects all."""

    since: Annotated[str, _TIME] = Field(
        "", description="parts triggered then or later: 2026-11-22 or 2026-11-22T14:30, UTC"
    )
    until: Annotated[str, _TIME] = Field(
        "", description="parts triggered then or earlier; a date or a minute counts to its end"
    )
    label: str = Field("", alias="class", description="the texture that was found")
    recipe: str = Field("", description="name of the recipe")
    simulated: Literal["", "false", "only"] = Field(
        "false", description="only: parts of a simulated rig; by default production"
    )

    @property
    def selection(self) -> Selection:
        """The parts that they select."""
        return Selection(
            since_utc=utc_bound("since", self.since) if self.since else None,
            until_utc=utc_bound("until", self.until, is_end=True) if self.until else None,
            label=self.label or None,
            recipe=self.recipe or None,
            simulated=_SIMULATED[self.simulated],
        )


class Filters(StatisticsFilters):
    """Filters of parts."""

    verdict: Annotated[Decision | Literal[""], BeforeValidator(str.upper)] = Field(
        "", description="the verdict that holds, after overrides: PASS, FAIL, UNKNOWN or ERROR"
    )
    part: str = Field("", description="part of the id, in upper or lower case")
    simulated: Literal["", "true", "false", "only"] = Field(  # type: ignore[assignment]
        "false",
        description="true: also parts of a simulated rig; only: these alone; by default production",
    )

    @property
    def selection(self) -> Selection:
        """The parts that they select."""
        decision = Decision(self.verdict) if self.verdict else None
        return replace(super().selection, decision=decision, id_contains=self.part or None)


_FILTERS = {field.alias or name: field.description for name, field in Filters.model_fields.items()}
_OF_ONE_PART, _TIMES = ("verdict", "part"), {"since", "until"}


def selection_of(query: Mapping[str, str], filters: type[StatisticsFilters] = Filters) -> Selection:
    """Return the selection that a query describes."""
    return validated(dict(query), filters, "filters").selection


@dataclass(frozen=True)
class FilterForm:
    """The form that selects parts: its values, and names to choose from."""

    # Filters of the query, with times in UTC; on a simulated rig simulated parts unless the query
    # says otherwise.
    values: Mapping[str, str]
    known: Mapping[str, tuple[str, ...]]  # names in the results, by ``class`` and ``recipe``

    @classmethod
    def of(cls, call: Call) -> Self:
        """Return the form of a page."""
        query = call.request.query_params
        entered = {name: value for name in _FILTERS if (value := query.get(name))}
        for name in _TIMES & entered.keys():
            with suppress(InputError):  # `selection_of` raises it again
                is_end = name == "until"
                entered[name] = utc_bound(name, entered[name], is_end=is_end, is_local=True)
        default = "only" if call.panel.live.snapshot().simulated else "false"
        labels, recipes = known_names(call.panel.results.store)
        return cls({"simulated": default} | entered, {"class": labels, "recipe": recipes})

    @property
    def query(self) -> str:
        """The filters as the query of an address."""
        return urlencode(self.values)

    @property
    def statistics_query(self) -> str:
        """The filters that statistics have, of production or of a simulated rig."""
        values = {name: value for name, value in self.values.items() if name not in _OF_ONE_PART}
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
        """Return the classes or recipes of all results, and the selected one."""
        return list(dict.fromkeys(filter(None, (*self.known[name], self.value(name)))))
