"""`Tokens`: API clients and the hashes of their tokens, in ``tokens.json``."""

import hashlib
import secrets
from collections.abc import Callable
from pathlib import Path

from pydantic import Field

from capture.base.names import Name
from capture.base.utc_time import utc_text
from classify.base.models import Section, validated

from .errors import Conflict, NotFound
from .private_file import PrivateFile
from .users import Role, require_name

_FILE = "tokens.json"
_MAX_CLIENTS = 1000
_PREFIX = "ps4_"  # by which scanners for secrets recognise a token
_SECRET_BYTES = 32  # random bytes of a token


class _Client(Section):
    """A program that uses the API."""

    name: Name
    role: Role = Field(strict=False)
    # Hash of its token, without salt or stretching: nobody can try 2**256 tokens.
    sha256: str = Field(pattern=r"^[0-9a-f]{64}$")
    created_utc: str = Field(max_length=40)


class _File(Section):
    clients: tuple[_Client, ...] = Field(default=(), max_length=_MAX_CLIENTS, strict=False)


class Tokens:
    """API clients of a station. Thread-safe; sees changes by other programs at once."""

    def __init__(self, folder: Path) -> None:
        self._file = PrivateFile(folder / _FILE, _File)

    def all(self) -> tuple[_Client, ...]:
        """Return all clients, by name."""
        return tuple(sorted(self._file.read().clients, key=lambda client: client.name))

    def find(self, token: str) -> _Client | None:
        """Return the client of a token."""
        # The time of comparing hashes reveals nothing of the token.
        digest = _sha256(token)
        clients = (client for client in self._file.read().clients if client.sha256 == digest)
        return next(clients, None)

    def add(self, name: str, role: Role, record: Callable[[], None] = lambda: None) -> str:
        """Add a client and return its token, which is not stored; `record` as for `Users.put`."""
        require_name("client", name)
        token = _PREFIX + secrets.token_urlsafe(_SECRET_BYTES)
        values = {
            "name": name, "role": role, "sha256": _sha256(token), "created_utc": utc_text()
        }  # fmt: skip
        client = validated(values, _Client, "client")
        with self._file.changing():
            clients = self.all()
            if any(client.name == name for client in clients):
                raise Conflict(f"client {name}: there is one already; remove it first")
            if len(clients) >= _MAX_CLIENTS:
                raise Conflict(f"client {name}: there are {_MAX_CLIENTS} clients already")
            record()
            self._file.write(_File(clients=(*clients, client)))
        return token

    def remove(self, name: str, record: Callable[[_Client], None] = lambda _: None) -> None:
        """Remove a client, whose token is invalid at once; `record` as for `Users.put`."""
        with self._file.changing():
            clients = self.all()
            others = tuple(client for client in clients if client.name != name)
            removed = next((client for client in clients if client.name == name), None)
            if removed is None:
                text = f"client {name[:100]}: no such client; see ps4rig station token list"
                raise NotFound(text)
            record(removed)
            self._file.write(_File(clients=others))


def _sha256(token: str) -> str:
    return hashlib.sha256(token.encode("utf-8", "surrogateescape")).hexdigest()
