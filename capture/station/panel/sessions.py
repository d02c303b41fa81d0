"""`Sessions`: browsers that are logged in; `LoginLimit`: the limit of failed logins."""

import secrets
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from capture.station.domain.roles import Identity
from capture.station.domain.users import User, Users

# A session ends with the shift, and after a break without a request.
LONGEST_S = 12 * 3600.0
IDLE_S = 3600.0
# A hundred browsers with ten sessions each; the oldest ends.
MOST_SESSIONS = 1000
# OWASP's advice for logins: few failures in a row, then a pause. A name and an address are counted
# apart, so that neither one password for many names nor many passwords for one name can be tried.
FAILURES_OF_A_NAME, FAILURES_OF_AN_ADDRESS = 5, 20
PAUSE_S = 60.0
_MOST_COUNTED = 10_000
# Names of users have up to 100 letters. Without the cut, names of requests could take 1 GB.
_COUNTED_LETTERS = 101


@dataclass
class _Session:
    name: str
    # The session ends when the password changes.
    password_hash: str
    csrf: str
    begun_s: float
    used_s: float


class Sessions:
    """Sessions by their secret cookie, thread-safe; each has the present role of its user."""

    def __init__(self, users: Users, now_s: Callable[[], float] = time.monotonic) -> None:
        self._users, self._now_s = users, now_s
        self._lock = threading.Lock()
        self._sessions: dict[str, _Session] = {}

    def begin(self, user: User) -> str:
        """Begin a session and return its cookie."""
        now_s, cookie = self._now_s(), secrets.token_urlsafe(32)
        session = _Session(user.name, user.password, secrets.token_urlsafe(32), now_s, now_s)
        with self._lock:
            self._sessions[cookie] = session
            while len(self._sessions) > MOST_SESSIONS:
                del self._sessions[min(self._sessions, key=lambda c: self._sessions[c].used_s)]
        return cookie

    def find(self, cookie: str) -> Identity | None:
        """Return who a cookie belongs to, or None if its session is over."""
        now_s = self._now_s()
        with self._lock:
            session = self._sessions.get(cookie)
            if session is None:
                return None
            user = self._users.get(session.name)
            if (
                user is None
                or user.password != session.password_hash
                or now_s - session.used_s > IDLE_S
                or now_s - session.begun_s > LONGEST_S
            ):
                del self._sessions[cookie]
                return None
            session.used_s = now_s
        return Identity(user.name, user.role, "page", session.csrf)

    def end(self, cookie: str) -> None:
        """End a session."""
        with self._lock:
            self._sessions.pop(cookie, None)


class LoginLimit:
    """Counts failed logins of names and addresses until `PAUSE_S` after the last. Thread-safe."""

    def __init__(self, now_s: Callable[[], float] = time.monotonic) -> None:
        self._now_s = now_s
        self._lock = threading.Lock()
        self._failures: dict[tuple[str, str], tuple[int, float]] = {}

    def begin(self, name: str, address: str) -> float:
        """Count an attempt as a failure; return how long to wait in s, 0 if it is allowed.

        It is counted before the password is tried, so that simultaneous attempts all count.
        """
        counted = name[:_COUNTED_LETTERS]
        keys = (("name", counted, FAILURES_OF_A_NAME), ("address", address, FAILURES_OF_AN_ADDRESS))
        now_s = self._now_s()
        with self._lock:
            wait_s = max(self._wait_s((kind, key), allowed) for kind, key, allowed in keys)
            if wait_s > 0.0:
                return wait_s
            for kind, key, _ in keys:
                count, last_s = self._failures.pop((kind, key), (0, now_s))
                is_old = now_s - last_s > PAUSE_S
                self._failures[kind, key] = (1 if is_old else count + 1, now_s)
            while len(self._failures) > _MOST_COUNTED:
                del self._failures[next(iter(self._failures))]
            return 0.0

    def succeeded(self, name: str, address: str) -> None:
        """Do not count the last attempt as a failure; forget the failures of its name."""
        with self._lock:
            self._failures.pop(("name", name), None)
            count, last_s = self._failures.get(("address", address), (1, 0.0))
            self._failures["address", address] = (count - 1, last_s)

    def _wait_s(self, key: tuple[str, str], allowed: int) -> float:
        count, last_s = self._failures.get(key, (0, 0.0))
        return max(0.0, last_s + PAUSE_S - self._now_s()) if count >= allowed else 0.0
