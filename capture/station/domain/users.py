"""`Users` of a station's panel and their roles; `Tokens` of the programs that use its API."""

import hashlib
import re
import secrets
import threading
import unicodedata
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Literal

from argon2 import PasswordHasher
from argon2.exceptions import Argon2Error, InvalidHashError
from pydantic import Field, field_validator

from capture.base.names import Name, file_name
from capture.base.utc_time import utc_text
from classify.base.errors import InputError
from classify.base.models import Section, validated

from .errors import Conflict, NotFound
from .private_file import PrivateFile

_MAX_USERS = 1000
_MAX_CLIENTS = 1000
# NIST SP 800-63B, 5.1.1: at least 8 characters, and a limit of 64 or more; no other rules.
MIN_PASSWORD_LENGTH, MAX_PASSWORD_LENGTH = 8, 256
# The user of the line's screens, whose password is a PIN. Five attempts a minute find a PIN of 6
# digits in 70 days on average.
KIOSK = "kiosk"
_PIN = re.compile(r"[0-9]{6,12}")
# The defaults of argon2-cffi are the second recommendation of RFC 9106: 64 MiB, 3 passes.
HASHER = PasswordHasher()
_TOKEN_PREFIX = "ps4_"  # by which scanners for secrets recognise a token
_SECRET_BYTES = 32  # random bytes of a token


class Role(StrEnum):
    """A role; each one includes the permissions of the previous one."""

    OPERATOR = "operator"  # sees everything, triggers, acknowledges
    ENGINEER = "engineer"  # overrides verdicts, teaches, approves, changes settings
    ADMINISTRATOR = "administrator"  # users and tokens

    def includes(self, other: "Role") -> bool:
        """Whether this role may do what `other` may."""
        order = tuple(Role)
        return order.index(self) >= order.index(other)


@dataclass(frozen=True)
class Identity:
    """A person or a program that asks for something."""

    name: str
    role: Role
    # ``this machine`` while the station has no users.
    via: Literal["page", "kiosk", "API", "command", "this machine"]
    csrf: str = ""  # token that a change from this session must carry; empty for others


def require_name(kind: str, name: str) -> None:
    """Check the name of a user or client."""
    try:
        file_name(name)
    except ValueError as error:
        raise InputError(
            f"{kind} name {name[:100]!r}: up to 100 letters, digits and _ . -, the first a letter "
            "or digit"
        ) from error


class User(Section):
    """A user; `password` is the argon2id hash."""

    name: Name
    role: Role = Field(strict=False)
    password: str = Field(min_length=1, max_length=1000)


class _UsersFile(Section):
    users: tuple[User, ...] = Field(default=(), max_length=_MAX_USERS, strict=False)

    @field_validator("users")
    @classmethod
    def _names_differ(cls, users: tuple[User, ...]) -> tuple[User, ...]:
        if len({user.name for user in users}) < len(users):
            raise ValueError("a name is listed twice")
        return users


class Users:
    """The users of a station. Thread-safe; a change by another program is seen at once."""

    def __init__(self, folder: Path) -> None:
        self._file = PrivateFile(folder / "users.json", _UsersFile)
        # One hash at a time: each takes 64 MiB and about 0.2 s of processor time.
        self._hashing = threading.Lock()
        # Verified for an unknown name, so that the time does not reveal which names exist.
        self._dummy_hash = ""

    def all(self) -> tuple[User, ...]:
        """Return all users, by name."""
        return tuple(sorted(self._file.read().users, key=lambda user: user.name))

    def get(self, name: str) -> User | None:
        """Return the user with this name."""
        return next((user for user in self.all() if user.name == name), None)

    def put(
        self,
        name: str,
        role: Role,
        password: str,
        expected: User | None = None,
        record: Callable[[User | None], None] = lambda _: None,
    ) -> None:
        """Add or change a user; Conflict if the present one is not `expected` (None: no check).

        `record` gets the present user, or None, before the change, and may raise to prevent it.
        """
        user = User(name=name, role=role, password=self._hash(_require_account(name, password)))
        with self._file.changing():
            before, others = self._split(name)
            if expected is not None and before != expected:
                raise Conflict(f"user {name}: was changed meanwhile; log in again")
            if len(others) >= _MAX_USERS:
                raise Conflict(f"user {name}: there are {_MAX_USERS} users already")
            _require_administrator((*others, user), before)
            record(before)
            self._file.write(_UsersFile(users=(*others, user)))

    def remove(self, name: str, record: Callable[[User], None] = lambda _: None) -> None:
        """Remove a user and end the user's sessions; `record` as for `put`."""
        with self._file.changing():
            user, others = self._split(name)
            if user is None:
                raise NotFound(f"user {name[:100]}: no such user; see ps4rig station user list")
            _require_administrator(others, user)
            record(user)
            self._file.write(_UsersFile(users=others))

    def verified(self, name: str, password: str) -> User | None:
        """Return the user with this name and password, or None; both take the same time."""
        user, normalised = self.get(name), unicodedata.normalize("NFKC", password)
        if len(normalised) > MAX_PASSWORD_LENGTH or not _is_encodable(normalised):
            return None
        self._dummy_hash = self._dummy_hash or self._hash(secrets.token_hex())
        try:
            with self._hashing:
                stored = self._dummy_hash if user is None else user.password
                HASHER.verify(stored, normalised)
        except (Argon2Error, InvalidHashError):
            return None
        return user

    def _split(self, name: str) -> tuple[User | None, tuple[User, ...]]:
        """Return the user with this name, and all others."""
        users = self.all()
        others = tuple(user for user in users if user.name != name)
        return next((user for user in users if user.name == name), None), others

    def _hash(self, password: str) -> str:
        with self._hashing:
            return HASHER.hash(password)


def _require_administrator(users: tuple[User, ...], changed: User | None) -> None:
    """Check that a change does not take the last administrator from other users."""
    if changed is None or changed.role is not Role.ADMINISTRATOR:
        return
    if users and all(user.role is not Role.ADMINISTRATOR for user in users):
        raise Conflict(f"user {changed.name}: is the last administrator; add another one first")


def _require_account(name: str, password: str) -> str:
    """Check name and password of a new user; return the password in its normal form."""
    require_name("user", name)
    if name == KIOSK and not _PIN.fullmatch(password):
        raise InputError("a PIN has 6 to 12 digits")
    normalised = unicodedata.normalize("NFKC", password)
    if name != KIOSK and not MIN_PASSWORD_LENGTH <= len(normalised) <= MAX_PASSWORD_LENGTH:
        raise InputError(
            f"a password has {MIN_PASSWORD_LENGTH} to {MAX_PASSWORD_LENGTH} characters, "
            f"this one has {len(normalised)}"
        )
    if not _is_encodable(normalised):
        raise InputError("the password is not valid UTF-8; give another one")
    return normalised


def _is_encodable(text: str) -> bool:
    """Whether a text has no lone surrogates, which JSON and the terminal can contain."""
    return not any("\ud800" <= character <= "\udfff" for character in text)


class _Client(Section):
    """A program that uses the API."""

    name: Name
    role: Role = Field(strict=False)
    # Hash of its token, without salt or stretching: nobody can try 2**256 tokens.
    sha256: str = Field(pattern=r"^[0-9a-f]{64}$")
    created_utc: str = Field(max_length=40)


class _TokensFile(Section):
    clients: tuple[_Client, ...] = Field(default=(), max_length=_MAX_CLIENTS, strict=False)


class Tokens:
    """API clients of a station. Thread-safe; sees changes by other programs at once."""

    def __init__(self, folder: Path) -> None:
        self._file = PrivateFile(folder / "tokens.json", _TokensFile)

    def all(self) -> tuple[_Client, ...]:
        """Return all clients, by name."""
        return tuple(sorted(self._file.read().clients, key=lambda client: client.name))

    def find(self, token: str) -> _Client | None:
        """Return the client of a token."""
        # The time of comparing hashes reveals nothing of the token.
        digest = _token_sha256(token)
        clients = (client for client in self._file.read().clients if client.sha256 == digest)
        return next(clients, None)

    def add(self, name: str, role: Role, record: Callable[[], None] = lambda: None) -> str:
        """Add a client and return its token, which is not stored; `record` as for `Users.put`."""
        require_name("client", name)
        token = _TOKEN_PREFIX + secrets.token_urlsafe(_SECRET_BYTES)
        values = {
            "name": name, "role": role, "sha256": _token_sha256(token), "created_utc": utc_text()
        }  # fmt: skip
        client = validated(values, _Client, "client")
        with self._file.changing():
            clients = self.all()
            if any(client.name == name for client in clients):
                raise Conflict(f"client {name}: there is one already; remove it first")
            if len(clients) >= _MAX_CLIENTS:
                raise Conflict(f"client {name}: there are {_MAX_CLIENTS} clients already")
            record()
            self._file.write(_TokensFile(clients=(*clients, client)))
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
            self._file.write(_TokensFile(clients=others))


def _token_sha256(token: str) -> str:
    return hashlib.sha256(token.encode("utf-8", "surrogateescape")).hexdigest()
