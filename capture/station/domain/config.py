"""`StationConfig`: the file ``station.toml`` of a station."""

import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Self, get_args

from pydantic import AfterValidator, BaseModel, Field, model_validator

from capture.base.names import Name, Text
from classify.base.models import Degrees, Section, read_toml_as
from rig.config.simulation import DefectKind

from .interface_config import ModbusConfig, MqttConfig, PanelConfig

CONFIG = "station.toml"
SIM = "sim"
_Share = Annotated[float, Field(ge=0.0, le=1.0)]
_Surface = Annotated[str, Field(min_length=1, max_length=4096)]

_URL = re.compile(r"postgresql(\+psycopg)?://.*", re.DOTALL)


def _checked_results(text: str) -> str:
    if "://" in text and not _URL.fullmatch(text):
        raise ValueError(
            f"results = {text.partition('://')[0]!r}://...: give a file such as "
            "'results.sqlite', or postgresql://USER:PASSWORD@HOST/DATABASE"
        )
    return text


class Retention(Section):
    """Which set files of parts stay on disk; rows of results always stay."""

    pass_every: int = Field(
        default=20, ge=1, le=1_000_000, description="one in so many passed parts keeps its file"
    )
    # At least 1 day, because today's folder may still receive files.
    pass_days: float = Field(
        default=7.0, ge=1.0, le=36_500.0, description="age at which the other files are removed"
    )


class SimulatedParts(Section):
    """The parts below a simulated rig, drawn at random from a seed and the part's number."""

    seed: int = Field(
        default=100, ge=0, lt=2**31, description="should differ from that of the taught sets"
    )
    surfaces: tuple[_Surface, ...] = Field(
        default=("rock",),
        min_length=1,
        strict=False,
        description="expected surfaces, as in [simulation.placement] of rig.toml",
    )
    others: tuple[_Surface, ...] = Field(
        default=("sand",), strict=False, description="unexpected surfaces"
    )
    share_other: _Share = Field(default=0.02, description="of parts with an unexpected surface")
    orientations_deg: tuple[Degrees, ...] = Field(
        default=(), max_length=3600, strict=False, description="one of these; any if empty"
    )
    share_defective: _Share = Field(
        default=0.05, description="of parts with an expected surface that have one defect"
    )
    defects: tuple[DefectKind, ...] = Field(
        default=("scratch", "dent", "bump", "stain"), strict=False, description="their kinds"
    )

    @model_validator(mode="after")
    def _shares_have_something_to_draw(self) -> Self:
        for key, share, kinds in (
            ("share_other", self.share_other, self.others),
            ("share_defective", self.share_defective, self.defects),
        ):
            if share > 0.0 and not kinds:
                other = "others" if key == "share_other" else "defects"
                raise ValueError(f"{key} = {share:g}, but {other} is empty; give one, or share 0")
        return self


class StationConfig(Section):
    """The configuration of a station."""

    name: Name = Field(description="unique among the stations that share a database")
    rig: str = Field(
        default=SIM,
        min_length=1,
        max_length=4096,
        description="sim, or a rig.toml relative to the station's folder",
    )
    recipe: Name = Field(description="recipes/NAME.toml")
    results: Annotated[
        str, Field(min_length=1, max_length=4096), AfterValidator(_checked_results)
    ] = Field(default="results.sqlite", description="or postgresql://USER:PASSWORD@HOST/DATABASE")
    operator: Text | None = Field(
        default=None, description="person responsible for the results", examples=["Your name"]
    )
    trigger: Literal["timer", "enter", "sensor", "http", "modbus"] = Field(
        default="enter",
        description="what triggers the parts: timer, enter, sensor, http or modbus",
    )
    timer_s: float = Field(
        default=2.0,
        ge=0.0,
        le=86_400.0,
        description="period of the timer or simulated sensor; 0 is as fast as possible",
    )
    sensor_delay_ms: float = Field(
        default=0.0, ge=0.0, le=60_000.0, description="from the sensor's edge to the first light"
    )
    buffers: int = Field(
        default=2, ge=1, le=64, description="exposed parts that may wait for their verdict"
    )
    max_trigger_age_s: float = Field(
        default=1.0,
        ge=0.01,
        le=60.0,
        description="an older trigger is refused",
    )
    disk_floor_mb: int = Field(
        default=500, ge=1, le=10_000_000, description="with less free space triggers are refused"
    )
    plate_check: bool = Field(
        default=False, description="a white sheet is below the camera when the station starts"
    )
    reconnect_s: float = Field(
        default=5.0, ge=0.01, le=3600.0, description="between attempts to open a rig that was lost"
    )
    stop_after_errors: int = Field(
        default=5,
        ge=1,
        le=1_000_000,
        description="number of errors in a row that stops the line until one is acknowledged",
    )
    retention: Retention = Field(
        default=Retention(), description="which set files stay; those that did not pass always do"
    )
    simulated_parts: SimulatedParts = Field(
        default=SimulatedParts(), description="the parts below a simulated rig"
    )
    panel: PanelConfig = Field(
        default=PanelConfig(),
        description="the panel and the HTTP API; other machines need users and HTTPS",
    )
    modbus: ModbusConfig | None = Field(default=None, description="the registers for a PLC")
    mqtt: MqttConfig | None = Field(default=None, description="results for a broker")


def read_config(path: Path) -> StationConfig:
    """Read a ``station.toml``."""
    missing = f"no such station; make one with ps4rig station init {path.parent}"
    return read_toml_as(path, StationConfig, missing)


def example_config(name: str) -> str:
    """Return a commented configuration of a station called `name`."""
    head = "# Configuration of an inspection station. A line that begins with # is a comment.", ""
    return "\n".join([*head, *_entries(StationConfig, {"name": name, "recipe": "example"})]) + "\n"


def _entries(
    model: type[BaseModel], values: Mapping[str, Any], comment_mark: str = ""
) -> Iterator[str]:
    """Yield lines: all keys with their `values` or defaults, then the sections."""
    sections = []
    for key, field in model.model_fields.items():
        kinds = (field.annotation, *get_args(field.annotation))
        section = next(
            (kind for kind in kinds if isinstance(kind, type) and issubclass(kind, Section)), None
        )
        if section is not None:
            section_mark = "# " if field.default is None else ""
            sections += ["", f"# {field.description}", f"{section_mark}[{key}]"]
            sections += _entries(section, {}, section_mark)
            continue
        value = values.get(key, None if field.is_required() else field.default)
        entry = (field.examples or [None])[0] if value is None else value
        mark = "# " if value is None else comment_mark
        yield f"{mark}{key} = {json.dumps(entry)}  # {field.description}"
    yield from sections
