"""``ps4rig station history`` and ``ps4rig station override``."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from capture.base.console import new_table, out, print_table
from capture.commands import options
from capture.station.domain.verdict import Decision
from classify.base.errors import InputError

if TYPE_CHECKING:
    from capture.station.results.history import Counters, HistoryEntry, Tally
    from capture.station.results.store import ResultStore

_SHOWN_PARTS = 50  # parts in the table of a terminal


def history(
    folder: options.Station,
    json: options.Json = False,
    csv: Annotated[bool, typer.Option("--csv", help="Print a line of CSV for each part.")] = False,
    since: Annotated[
        str | None,
        typer.Option(metavar="TIME", help="Parts triggered then or later: 2026-11-22T14:30, UTC."),
    ] = None,
    until: Annotated[
        str | None,
        typer.Option(
            metavar="TIME", help="Parts triggered then or earlier; a date or minute: all of it."
        ),
    ] = None,
    verdict: Annotated[
        Decision | None,
        typer.Option(
            case_sensitive=False,
            help="The verdict that holds, after overrides.",
            metavar="PASS|FAIL|UNKNOWN|ERROR",
        ),
    ] = None,
    label: Annotated[
        str | None, typer.Option("--class", metavar="CLASS", help="The texture that was found.")
    ] = None,
    recipe: Annotated[str | None, typer.Option(metavar="NAME", help="Name of the recipe.")] = None,
    include_simulated: Annotated[
        bool, typer.Option("--include-simulated", help="Parts of a simulated rig, too.")
    ] = False,
) -> None:
    """Show the parts that a station has judged; a table has the last 50.

    Parts of a simulated rig do not belong to production: they are left out and counted apart.
    """
    from capture.station.results.history import Selection, csv_pieces, json_pieces, utc_bound

    if json and csv:
        raise InputError("--json and --csv: give one of them")
    selection = Selection(
        since_utc=None if since is None else utc_bound("--since", since),
        until_utc=None if until is None else utc_bound("--until", until, is_end=True),
        decision=verdict,
        label=label,
        recipe=recipe,
    )
    chosen_parts = selection if include_simulated else replace(selection, simulated=False)
    with _results_of(folder) as store:
        if csv:
            sys.stdout.writelines(csv_pieces(store.parts(chosen_parts)))
        elif json:
            counters, chain = store.counters(selection), store.chain_head()
            sys.stdout.writelines(
                json_pieces(store.station, counters, chain, store.parts(chosen_parts))
            )
        else:
            _show(store.station, store.counters(selection), include_simulated)
            chain = store.chain_head()
            out.print(f"chain of hashes: {chain.link} rows, head {chain.chain_sha256}")
            _show_parts(store.parts(chosen_parts, newest=_SHOWN_PARTS))


def override(
    folder: options.Station,
    part: Annotated[str, typer.Argument(metavar="PART", help="Id of the part.")],
    verdict: Annotated[
        Decision, typer.Option(case_sensitive=False, help="PASS or FAIL.", metavar="PASS|FAIL")
    ],
    by: Annotated[str, typer.Option(metavar="NAME", help="Who decides.")],
    reason: Annotated[str, typer.Option(metavar="TEXT", help="Why.")],
) -> None:
    """Give a part another verdict; the station's own stays in the results beside it."""
    from capture.station.domain.folder import StationFolder
    from capture.station.results.audit import changing_on_the_terminal

    with (
        changing_on_the_terminal(StationFolder(folder), by) as (results, who),
        _results_of(folder) as store,
    ):
        entry = store.part(part)
        if entry is None:
            raise InputError(f"part {part[:100]}: station {store.station} has no result of it")
        results.override(who, entry, decision=verdict, by=by, reason=reason)
    out.print(f"{part}: {verdict}, by {by}: {reason}")


def _results_of(folder: Path) -> ResultStore:
    from capture.station.domain.folder import StationFolder
    from capture.station.results.store import open_store

    station = StationFolder(folder)
    return open_store(station.results, station.config.name, exclusive=False)


def _show(station: str, counters: Counters, include_simulated: bool) -> None:
    out.print(f"{station}: {_summary(counters.production)}")
    simulated = counters.simulated
    if include_simulated:
        out.print(f"{station}, SIMULATED: {_summary(simulated)}")
    elif simulated.parts:
        out.print(
            f"parts of a simulated rig, left out: {simulated.parts} (--include-simulated)",
        )


def _summary(tally: Tally) -> str:
    collected = f"; collected to be taught: {tally.collected}" if tally.collected else ""
    if not tally.parts:
        return f"no parts{collected}; triggers refused: {tally.refused_triggers}"
    counts, station_counts = (
        ", ".join(f"{verdicts.get(decision, 0)} {decision}" for decision in Decision)
        for verdicts in (tally.verdicts, tally.station_verdicts)
    )
    passed_share = tally.verdicts.get(Decision.PASS, 0) / tally.parts
    before = f"; before overrides {station_counts}" if station_counts != counts else ""
    return (
        f"parts {tally.parts}: {counts}; {passed_share:.1%} passed{before}{collected}; "
        f"triggers refused: {tally.refused_triggers}"
    )


def _show_parts(entries: Iterable[HistoryEntry]) -> None:
    table = new_table("number", "part", "triggered (UTC)", "verdict", "reason", prose="reason")
    for entry in entries:
        result, decision = entry.result, str(entry.decision)
        reason = result.verdict.reason
        if entry.override is not None:
            changed = entry.override
            decision += " *"
            reason = (
                f"{changed.by}: {changed.reason} (* station: {result.verdict.decision}, {reason})"
            )
        if entry.set_removed_utc is not None:
            reason += f"; set removed {entry.set_removed_utc[:10]}"
        table.add_row(
            str(result.number),
            result.part_id,
            result.triggered_utc[:19].replace("T", " "),
            f"{decision} SIMULATED" if result.simulated else decision,
            reason,
        )
    if table.row_count:
        print_table(table)
