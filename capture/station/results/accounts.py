"""`Accounts`: change users and API clients; each change is recorded."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from capture.station.domain.errors import Conflict
from capture.station.domain.folder import StationFolder
from capture.station.domain.users import KIOSK, Identity, Role, Tokens, User, Users

from .audit import ResultsAccess, changing_on_the_terminal

_RESERVED = (KIOSK, "local", "nobody", "plc", "ps4rig", "root", "station", "system")


@dataclass(frozen=True)
class Accounts:
    """The users and API clients of a station, for changes by `who`."""

    users: Users
    tokens: Tokens
    results: ResultsAccess
    who: Identity

    def put_user(self, name: str, role: Role, password: str, expected: User | None = None) -> None:
        """Add a user, or change role and password of one; see `Users.put`."""
        _require_free("user", name)
        self._put(name, role, password, expected)

    def put_kiosk(self, pin: str) -> None:
        """Set the PIN by which the line's screens log in as an operator."""
        self._put(KIOSK, Role.OPERATOR, pin)

    def _put(self, name: str, role: Role, password: str, expected: User | None = None) -> None:
        def record(before: User | None) -> None:
            old_role = None if before is None else before.role
            self.results.record(self.who, f"user {name}", old_role, f"{role}, new password")

        self.users.put(name, role, password, expected, record)

    def remove_user(self, name: str) -> None:
        """Remove a user; see `Users.remove`."""
        self.users.remove(
            name, lambda user: self.results.record(self.who, f"user {name}", user.role)
        )

    def add_client(self, name: str, role: Role) -> str:
        """Add a client and return its token; see `Tokens.add`."""
        _require_free("client", name)
        return self.tokens.add(
            name, role, lambda: self.results.record(self.who, f"client {name}", None, role)
        )

    def remove_client(self, name: str) -> None:
        """Remove a client; see `Tokens.remove`."""
        self.tokens.remove(
            name, lambda client: self.results.record(self.who, f"client {name}", client.role)
        )


def _require_free(kind: str, name: str) -> None:
    """Refuse names that the log of changes uses for the system itself."""
    if name.lower() in _RESERVED:
        raise Conflict(f"{kind} {name}: is reserved; give another name")


@contextmanager
def accounts_on_the_terminal(folder: StationFolder) -> Iterator[Accounts]:
    """Yield the accounts for changes that are recorded under the user of this shell."""
    with changing_on_the_terminal(folder) as (results, who):
        yield Accounts(Users(folder.path), Tokens(folder.path), results, who)
