"""Figures of a run in the text format of Prometheus."""

from collections.abc import Iterator
from importlib.metadata import version

from capture.station.domain.verdict import Decision
from capture.station.run.states import State
from capture.station.run.station_state import StationState

MEDIA_TYPE = "text/plain; version=0.0.4; charset=utf-8"


def metrics_text(live: StationState) -> str:
    """Return the figures of a snapshot; counters begin at 0 with each run."""
    return "".join(f"{line}\n" for line in _lines(live))


def _lines(live: StationState) -> Iterator[str]:
    yield from _family("info", "gauge", "The station and its software.")
    labels = f'station="{live.station}",version="{version("ps4rig")}"'
    yield f"ps4rig_info{{{labels}}} 1"
    yield from _family("simulated", "gauge", "1 if the rig is simulated.")
    yield f"ps4rig_simulated {int(live.simulated)}"
    if live.recipe is not None:
        yield from _family("recipe", "gauge", "1 for the recipe by which parts are judged.")
        name, number, sha256 = live.recipe.name, live.recipe.version, live.recipe.sha256
        yield f'ps4rig_recipe{{name="{name}",version="{number}",sha256="{sha256}"}} 1'
    yield from _family("state", "gauge", "1 for the present state.")
    for state in State:
        yield f'ps4rig_state{{state="{state}"}} {int(state is live.state)}'
    yield from _family("device_fault", "gauge", "1 for a device with a fault.")
    for device in live.devices:
        yield f'ps4rig_device_fault{{device="{device.name}"}} {int(device.status == "fault")}'
    yield from _family("parts_total", "counter", "Parts of this run by verdict of the station.")
    for decision in Decision:
        count = live.announced.get(decision, 0)
        yield f'ps4rig_parts_total{{verdict="{decision}"}} {count}'
    yield from _family("refused_triggers_total", "counter", "Triggers that were not served.")
    yield f"ps4rig_refused_triggers_total {live.refused}"
    yield from _family("subscribers", "gauge", "Browsers and programs that follow the events.")
    yield f"ps4rig_subscribers {live.subscribers}"
    yield from _family("latency_seconds", "summary", "From the exposure to the announcement.")
    yield f"ps4rig_latency_seconds_sum {live.total_latency_ms / 1e3:.6f}"
    yield f"ps4rig_latency_seconds_count {sum(live.announced.values())}"


def _family(name: str, kind: str, meaning: str) -> Iterator[str]:
    yield f"# HELP ps4rig_{name} {meaning}"
    yield f"# TYPE ps4rig_{name} {kind}"
