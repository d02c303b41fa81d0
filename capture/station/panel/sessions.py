"""`Sessions`: browsers that are logged in; `LoginLimit`: the limit of failed logins."""

import secrets
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

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
# Failed logins that get a row in the log of changes: so many in so long a time.
_MOST_RECORDED, _RECORDED_S = 100, 3600.0
_Counted = tuple[str, str, str]  # ``name``, ``address`` or ``both``; the name, the address
T = TypeVar("T")


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
    """Counts failed logins of names and addresses, and locks them for `PAUSE_S`. Thread-safe.

    An address from which a name has logged in has a count of its own for this name: failures from
    elsewhere never shut it out.
    """

    def __init__(self, now_s: Callable[[], float] = time.monotonic) -> None:
        self._now_s = now_s
        self._lock = threading.Lock()
        self._failures: dict[_Counted, tuple[int, float]] = {}
        # Apart from the counts: failures of others do not push a lock out of memory.
        self._locked_until_s: dict[_Counted, float] = {}
        self._was_right: dict[_Counted, None] = {}
        self._recorded_s: deque[float] = deque(maxlen=_MOST_RECORDED)
        self._unrecorded = 0

    def begin(self, name: str, address: str) -> float:
        """Count an attempt as a failure; return how long to wait in s, 0 if it is allowed.

        It is counted before the password is tried, so that simultaneous attempts all count.
        """
        now_s = self._now_s()
        with self._lock:
            limits = self._limits(name, address)
            wait_s = max(self._locked_until_s.get(key, 0.0) - now_s for key in limits)
            if wait_s > 0.0:
                return wait_s
            for key, allowed in limits.items():
                count, last_s = self._failures.pop(key, (0, now_s))
                count = 1 if now_s - last_s > PAUSE_S else count + 1
                if count < allowed:
                    _keep(self._failures, key, (count, now_s))
                else:
                    self._locked_until_s.pop(key, None)
                    _keep(self._locked_until_s, key, now_s + PAUSE_S)
            return 0.0

    def succeeded(self, name: str, address: str) -> None:
        """Do not count the last attempt as a failure; forget the failures of its name."""
        with self._lock:
            for key, allowed in self._limits(name, address).items():
                was_locked = self._locked_until_s.pop(key, None) is not None
                count, last_s = self._failures.pop(key, (allowed if was_locked else 1, 0.0))
                if key[0] == "address" and count > 1:
                    _keep(self._failures, key, (count - 1, self._now_s() if was_locked else last_s))
            self._was_right.pop(("both", name, address), None)
            _keep(self._was_right, ("both", name, address), None)

    def unrecorded(self) -> int | None:
        """Take the number of failures without a row before this one; None if it gets none too."""
        now_s = self._now_s()
        with self._lock:
            is_full = len(self._recorded_s) == _MOST_RECORDED
            if is_full and now_s - self._recorded_s[0] < _RECORDED_S:
                self._unrecorded += 1
                return None
            self._recorded_s.append(now_s)
            count, self._unrecorded = self._unrecorded, 0
            return count

    def _limits(self, name: str, address: str) -> dict[_Counted, int]:
        """What an attempt counts for, and how many failures of each are allowed."""
        name = name[:_COUNTED_LETTERS]
        both = ("both", name, address)
        if both in self._was_right:
            return {both: FAILURES_OF_A_NAME}
        return {
            ("name", name, ""): FAILURES_OF_A_NAME,
            ("address", "", address): FAILURES_OF_AN_ADDRESS,
        }


def _keep(counted: dict[_Counted, T], key: _Counted, value: T) -> None:
    """Add a value as the newest one, and forget the oldest beyond `_MOST_COUNTED`."""
    counted[key] = value
    while len(counted) > _MOST_COUNTED:
        del counted[next(iter(counted))]
