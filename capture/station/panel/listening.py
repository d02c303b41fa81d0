"""The panel's port: who may reach it, its socket, address and certificate."""

import socket
import ssl
from pathlib import Path

from capture.station.domain.interface_config import PanelConfig, listening_socket
from capture.station.domain.users import Users
from classify.base.errors import InputError

# A client that takes less than 48 kB in this time, the part of uvicorn's buffer that must be sent
# before it is filled again, does not read.
SEND_S = 30.0


def panel_listener(folder: Path, settings: PanelConfig) -> socket.socket:
    """Listen on the panel's port, if that is safe."""
    _require_safe(folder, settings)
    tls_context(folder, settings)
    return listening_socket(
        "panel",
        settings.host,
        settings.port,
        advice="give another port with --port, or --no-panel",
        # What a vanished browser has not acknowledged can be too little for the server to see.
        max_unacknowledged_ms=round(1000 * SEND_S),
    )


def _require_safe(folder: Path, settings: PanelConfig) -> None:
    """Check that a panel that other machines reach has users, and HTTPS."""
    if settings.is_for_this_machine:
        return
    if not settings.is_https:
        raise InputError(
            f"[panel] host = {settings.host}: other machines would send passwords in the clear; "
            'give tls_cert and tls_key, or behind_proxy = true, or host = "127.0.0.1"'
        )
    if not Users(folder).all():
        raise InputError(
            f"{folder}: a panel for other machines needs users; "
            f"run ps4rig station user add {folder} NAME --role administrator"
        )


def tls_context(folder: Path, settings: PanelConfig) -> ssl.SSLContext | None:
    """Return the context of HTTPS, or None without TLS."""
    files = settings.tls_files(folder)
    if files is None:
        return None
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    try:
        context.load_cert_chain(*files, password=_no_password)
    except (OSError, ValueError) as error:
        raise InputError(
            f"[panel] tls_cert = {files[0]}, tls_key = {files[1]}: cannot be used: {error}"
        ) from error
    return context


def panel_address(settings: PanelConfig, listener: socket.socket) -> str:
    """Return the address that browsers ask."""
    host = f"[{settings.host}]" if ":" in settings.host else settings.host
    scheme = "https" if settings.tls_cert else "http"
    return f"{scheme}://{host}:{listener.getsockname()[1]}/"


def _no_password() -> str:
    """Refuse a key with a password: OpenSSL would ask for it on the terminal."""
    raise ValueError("the key has a password; give one without")
