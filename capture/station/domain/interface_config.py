"""Sections of ``station.toml`` for the station's interfaces: panel, Modbus, MQTT."""

import ipaddress
import re
from pathlib import Path
from typing import Annotated, Self
from urllib.parse import urlsplit

from pydantic import AfterValidator, Field, IPvAnyAddress, field_validator, model_validator

from capture.base.names import Name
from classify.base.models import Section

_HOST_NAME = re.compile(r"[a-z0-9]([a-z0-9.-]{0,251}[a-z0-9])?")
_LOCALHOST = "localhost"
_PathText = Annotated[str, Field(min_length=1, max_length=4096)]


def _address(text: str) -> str:
    if text != _LOCALHOST:
        try:
            ipaddress.ip_address(text)
        except ValueError as error:
            raise ValueError(
                "give an IP address of this machine, such as 127.0.0.1, or 0.0.0.0 for all"
            ) from error
    return text


def _host_name(text: str) -> str:
    if not _HOST_NAME.fullmatch(text):
        raise ValueError(f"{text!r}: give a host name in lower case, without port")
    return text


_Address = Annotated[str, Field(max_length=100), AfterValidator(_address)]


class PanelConfig(Section):
    """The panel and the HTTP API."""

    host: _Address = Field(default="127.0.0.1", description="address of this machine to listen on")
    port: int = Field(default=8100, ge=0, le=65535, description="to listen on")
    tls_cert: _PathText | None = Field(
        default=None,
        description="PEM file for HTTPS, relative to the station's folder",
        examples=["panel.crt"],
    )
    tls_key: _PathText | None = Field(
        default=None, description="PEM file of its private key", examples=["panel.key"]
    )
    behind_proxy: bool = Field(
        default=False, description="a proxy on this machine terminates HTTPS"
    )
    names: tuple[Annotated[str, AfterValidator(_host_name)], ...] = Field(
        default=(),
        max_length=100,
        strict=False,
        description="host names by which browsers reach it; IP addresses need no entry",
    )
    kiosk_addresses: tuple[IPvAnyAddress, ...] = Field(
        default=(),
        max_length=100,
        strict=False,
        description="IP addresses of the line's screens, which log in with a PIN",
    )

    @model_validator(mode="after")
    def _tls_has_both_files(self) -> Self:
        if (self.tls_cert is None) != (self.tls_key is None):
            raise ValueError("tls_cert and tls_key: give both, or none")
        return self

    @model_validator(mode="after")
    def _proxy_is_on_this_machine(self) -> Self:
        if self.behind_proxy and not self._is_loopback:
            raise ValueError(
                f"behind_proxy = true with host = {self.host!r}: requests could bypass the proxy; "
                "give 127.0.0.1"
            )
        return self

    @property
    def _is_loopback(self) -> bool:
        return self.host == _LOCALHOST or ipaddress.ip_address(self.host).is_loopback

    @property
    def is_https(self) -> bool:
        """Whether browsers reach it by HTTPS only."""
        return self.tls_cert is not None or self.behind_proxy

    @property
    def is_for_this_machine(self) -> bool:
        """Whether all requests come from programs on this machine."""
        return self._is_loopback and not self.behind_proxy

    def tls_files(self, folder: Path) -> tuple[Path, Path] | None:
        """Return certificate and key of a station in `folder`, or None without TLS."""
        if self.tls_cert is None or self.tls_key is None:
            return None
        return folder / self.tls_cert, folder / self.tls_key


class ModbusConfig(Section):
    """The registers for a PLC; Modbus has no passwords: whoever reaches the port can trigger."""

    host: _Address = Field(default="127.0.0.1", description="address of this machine to listen on")
    port: int = Field(default=1502, ge=0, le=65535, description="to listen on")
    plc_addresses: tuple[IPvAnyAddress, ...] = Field(
        default=(),
        max_length=16,
        strict=False,
        description="IP addresses that may connect; any if empty",
    )
    recipes: tuple[Name, ...] = Field(
        default=(),
        max_length=1000,
        strict=False,
        description="the PLC knows them by their positions, from 1",
    )

    @field_validator("recipes")
    @classmethod
    def _recipes_differ(cls, names: tuple[str, ...]) -> tuple[str, ...]:
        # The registers show one position of a recipe: a PLC that selects the other waits forever.
        if len(set(names)) < len(names):
            raise ValueError("a recipe is named twice; give each once")
        return names


def _broker(text: str) -> str:
    try:
        url = urlsplit(text)
        is_usable = url.scheme in ("mqtt", "mqtts") and bool(url.hostname) and url.port != 0
    except ValueError:  # a port that is not a number
        is_usable = False
    if not is_usable or url.path.strip("/") or url.query or url.fragment:
        raise ValueError("give mqtt://HOST:PORT or mqtts://USER:PASSWORD@HOST:PORT")
    return text


class MqttConfig(Section):
    """Where results are published."""

    url: Annotated[str, Field(max_length=4096), AfterValidator(_broker)] = Field(
        description="mqtt://HOST:1883, or mqtts://USER:PASSWORD@HOST:8883 with TLS",
        examples=["mqtt://broker.example:1883"],
    )
    topic: Annotated[str, Field(pattern=r"^[^\s/#+$][^\s#+]{0,200}$")] = Field(
        description="beginning of all topics", examples=["plant/line-3"]
    )
