"""`StationConfig`: the file ``station.toml`` of a station."""

import re
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, FiniteFloat, model_validator

from capture.base.names import Name, Text
from classify.base.models import Degrees, Section, read_toml_as
from rig.config.simulation import DefectKind

from .interface_config import ModbusConfig, MqttConfig, PanelConfig

CONFIG = "station.toml"
SIM = "sim"
Share = Annotated[FiniteFloat, Field(ge=0.0, le=1.0)]
Surface = Annotated[str, Field(min_length=1, max_length=4096)]

_URL = re.compile(r"postgresql(\+psycopg)?://.*", re.DOTALL)


def _results(text: str) -> str:
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
    # At least 1, because today's folder may still receive files.
    pass_days: float = Field(
        default=7.0, ge=1.0, le=36_500.0, description="age at which the files of others are removed"
    )


class SimulatedParts(Section):
    """The parts below a simulated rig, drawn at random from a seed and the part's number."""

    seed: int = Field(
        default=100, ge=0, lt=2**31, description="should differ from the taught sets'"
    )
    surfaces: tuple[Surface, ...] = Field(
        default=("rock",),
        min_length=1,
        strict=False,
        description="expected ones, as in [simulation.placement] of rig.toml",
    )
    others: tuple[Surface, ...] = Field(
        default=("sand",), strict=False, description="unexpected surfaces"
    )
    share_other: Share = Field(default=0.02, description="of parts with an unexpected surface")
    orientations_deg: tuple[Degrees, ...] = Field(
        default=(), max_length=3600, strict=False, description="one of these; any if empty"
    )
    share_defective: Share = Field(
        default=0.05, description="of the expected surfaces; each has one defect"
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
    results: Annotated[str, Field(min_length=1, max_length=4096), AfterValidator(_results)] = Field(
        default="results.sqlite", description="or postgresql://USER:PASSWORD@HOST/DATABASE"
    )
    operator: Text | None = Field(default=None, description="person responsible for the results")
    trigger: Literal["timer", "enter", "sensor", "http", "modbus"] = Field(
        default="enter", description="what says that a part lies below the camera"
    )
    timer_s: float = Field(
        default=2.0,
        ge=0.0,
        le=86_400.0,
        description="period of the timer; 0 is as fast as possible",
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
        description="so many errors in a row stop the line",
    )
    retention: Retention = Field(
        default=Retention(), description="which set files stay; those that did not pass always do"
    )
    simulated_parts: SimulatedParts = Field(
        default=SimulatedParts(), description="the parts below a simulated rig"
    )
    panel: PanelConfig = Field(default=PanelConfig(), description="the panel and the HTTP API")
    modbus: ModbusConfig | None = Field(default=None, description="the registers for a PLC")
    mqtt: MqttConfig | None = Field(default=None, description="results for a broker")

    def rig_in(self, folder: Path) -> str:
        """Return the rig to open for a station in `folder`: ``sim`` or a path."""
        return self.rig if self.rig == SIM else str(folder / self.rig)

    def results_in(self, folder: Path) -> str:
        """Return the database of results for a station in `folder`: a URL, or a path."""
        return self.results if "://" in self.results else str(folder / self.results)


def read_config(path: Path) -> StationConfig:
    """Read a ``station.toml``."""
    missing = f"no such station; make one with ps4rig station init {path.parent}"
    return read_toml_as(path, StationConfig, missing)


EXAMPLE = """\
# Configuration of an inspection station. A line that begins with # is a comment.

name = "NAME"                # unique among the stations that share a database
rig = "sim"                  # the simulated rig, or a rig.toml relative to this folder
recipe = "example"           # recipes/example.toml, made by ps4rig station teach
results = "results.sqlite"   # or postgresql://USER:PASSWORD@HOST/DATABASE
# operator = "Your name"
trigger = "enter"            # the Enter key, "timer", "sensor", "http" or "modbus"
timer_s = 2.0                # period of the timer; 0 is as fast as possible
sensor_delay_ms = 0          # from the sensor's edge to the first light
buffers = 2                  # parts that may wait for their verdict
max_trigger_age_s = 1.0      # an older one is refused: another part may lie below the camera
disk_floor_mb = 500          # with less free space triggers are refused
plate_check = false          # true: a white sheet is below the camera when the station starts
reconnect_s = 5.0            # between attempts to open a rig that was lost
stop_after_errors = 5        # so many in a row stop the line, until somebody acknowledges one

# The set files of FAIL, UNKNOWN and ERROR are kept for ever.
[retention]
pass_every = 20              # one in this many passed parts keeps its file, too
pass_days = 7                # the files of the others are removed after this many days

# The panel, and the HTTP API. For access from other machines they need users (ps4rig station user
# add), and tls_cert and tls_key, or behind_proxy = true.
[panel]
host = "127.0.0.1"
port = 8100
# tls_cert = "panel.crt"     # PEM, relative to this folder
# tls_key = "panel.key"
# names = ["line-3.example"] # host names by which browsers reach it
# kiosk_addresses = ["192.168.0.21"] # screens of the line: ps4rig station user kiosk

# The registers for a PLC. Without this section there are none.
# [modbus]
# host = "127.0.0.1"         # or the address of this machine in the network of the PLC
# port = 1502
# plc_addresses = ["192.168.0.10"]   # that may connect; any if empty
# recipes = ["example"]      # the PLC knows them as 1, 2, ...

# Results for an MQTT broker.
# [mqtt]
# url = "mqtt://broker.example:1883"
# topic = "plant/line-3"

# Parts below the camera of a simulated rig; a real rig ignores them.
[simulated_parts]
seed = 100                   # should differ from the seed of the taught sets
surfaces = ["rock"]
others = ["sand"]            # unexpected surfaces
share_other = 0.02           # their share of the parts
orientations_deg = []        # one of these; any orientation if empty
share_defective = 0.05
defects = ["scratch", "dent", "bump", "stain"]
"""


def example_config(name: str) -> str:
    """Return a commented configuration of a station called `name`."""
    return EXAMPLE.replace("NAME", name, 1)
