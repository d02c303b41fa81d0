"""`Sessions`: browsers that are logged in; `LoginLimit`: the limit of failed logins."""

import hashlib
import math
import secrets
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

from itsdangerous import BadData, Signer, URLSafeSerializer
from pydantic import Field

from capture.station.domain.own_folder import SESSIONS as FILE
from capture.station.domain.private_file import PrivateFile
from capture.station.domain.users import KIOSK, Identity, User, Users
from classify.base.models import Section

from .security import Denied, Slots

# A session ends at the latest after a shift, or after this time without a request.
MAX_SESSION_S = 12 * 3600.0
IDLE_S = 3600.0
# A hundred browsers with ten sessions each. One more ends the least recently used session.
MAX_SESSIONS = 1000
# Number of ended sessions that are stored. They take half of the size limit of a private file.
_MAX_ENDED_SESSIONS = 10_000
# Failed logins before a pause, as OWASP advises. The limit for a name stops trying many passwords
# for it, and the limit for an address stops trying one password for many names.
FAILURES_OF_A_NAME, FAILURES_OF_AN_ADDRESS = 5, 20
_PAUSE_S = 60.0
# Logins at a time. Their passwords are hashed one after the other, and each login occupies one of
# the 40 threads that serve requests.
MAX_LOGINS_AT_ONCE = 4
_MAX_KEYS = 10_000  # with a count or a lock; bounds the memory
# Names are counted by their first letters, because long names of requests could take 1 GB. The
# names of users have up to 100 letters, so a longer name is never counted as one of them.
_COUNTED_LETTERS = 101
# Number of failed logins that get a row in the log of changes, in each period of this length.
_MAX_RECORDED, _RECORDED_S = 100, 3600.0
_Key = tuple[str, str, str]  # ``name``, ``address`` or ``both``; the name, the address
_T = TypeVar("_T")


class _File(Section):
    key: str = Field(default="", max_length=100)  # of the signatures; empty before the first login
    # Start time, in s since 1970, of each session whose user has logged out.
    ended: dict[str, float] = Field(default_factory=dict)


class Sessions:
    """Sessions by their signed cookies, thread-safe; each has the present role of its user."""

    def __init__(self, folder: Path, users: Users, now_s: Callable[[], float] = time.time) -> None:
        self._users, self._now_s = users, now_s
        self._file = PrivateFile(folder / FILE, _File, "remove it, and everybody logs in again")
        self._lock = threading.Lock()
        self._started_s = now_s()
        self._used_s: dict[str, float] = {}  # by session, least recently used first

    def begin(self, user: User) -> str:
        """Begin a session and return its cookie."""
        now_s, session = self._now_s(), secrets.token_urlsafe(16)
        with self._file.changing():
            file = self._file.read()
            if not file.key:
                file = _File(key=secrets.token_hex())
                self._file.write(file)
        with self._lock:
            self._mark_used(session, now_s)
        password = _signature(file.key, "password", user.password)
        return str(_signed(file.key).dumps([session, user.name, password, now_s]))

    def find(self, cookie: str) -> Identity | None:
        """Return the user of a cookie, or None if its session is over."""
        file, now_s, content = self._file.read(), self._now_s(), self._content(cookie)
        if content is None:
            return None
        session, name, password, begin_s = content
        user = self._users.get(name)
        if (
            user is None
            or password != _signature(file.key, "password", user.password)
            or session in file.ended
            or abs(now_s - begin_s) > MAX_SESSION_S
        ):
            return None
        with self._lock:
            # The requests before a restart are unknown. The start of the panel counts as one.
            default_s = self._started_s if begin_s <= self._started_s else -math.inf
            if now_s - self._used_s.get(session, default_s) > IDLE_S:
                return None
            self._mark_used(session, now_s)
        csrf = _signature(file.key, "csrf", session)
        return Identity(user.name, user.role, "kiosk" if user.name == KIOSK else "page", csrf)

    def end(self, cookie: str) -> None:
        """End a session."""
        content = self._content(cookie)
        if content is None:
            return
        session, _, _, begin_s = content
        with self._file.changing():
            file, now_s = self._file.read(), self._now_s()
            ended = {
                ended_session: ended_begin_s
                for ended_session, ended_begin_s in (*file.ended.items(), (session, begin_s))
                if now_s - ended_begin_s <= MAX_SESSION_S
            }
            newest = dict(list(ended.items())[-_MAX_ENDED_SESSIONS:])
            self._file.write(_File(key=file.key, ended=newest))

    def _content(self, cookie: str) -> tuple[str, str, str, float] | None:
        """Session, user, signature of the password and start; None if the signature is wrong."""
        key = self._file.read().key
        try:
            return tuple(_signed(key).loads(cookie)) if key else None
        except BadData:
            return None

    def _mark_used(self, session: str, now_s: float) -> None:
        self._used_s.pop(session, None)
        self._used_s[session] = now_s
        while len(self._used_s) > MAX_SESSIONS:
            del self._used_s[next(iter(self._used_s))]


def _signed(key: str) -> URLSafeSerializer:
    return URLSafeSerializer(key, "session", signer_kwargs={"digest_method": hashlib.sha256})


def _signature(key: str, purpose: str, text: str) -> str:
    signer = Signer(key, purpose, digest_method=hashlib.sha256)
    return signer.get_signature(text).decode()


class LoginLimit:
    """Locks names and addresses after failed logins; thread-safe."""

    # A name at an address where it has logged in has a count of its own. Failed logins from other
    # addresses cannot lock it there.

    def __init__(self, now_s: Callable[[], float] = time.monotonic) -> None:
        self._now_s = now_s
        self._lock = threading.Lock()
        self._failures: dict[_Key, tuple[int, float]] = {}
        # Not in `_failures`: counts of other names must not push a lock out of memory.
        self._locked_until_s: dict[_Key, float] = {}
        self._logged_in: dict[_Key, None] = {}
        self._recorded_s: deque[float] = deque(maxlen=_MAX_RECORDED)
        self._unrecorded = 0
        self._trying = Slots(MAX_LOGINS_AT_ONCE, "logins wait for their passwords")

    @contextmanager
    def attempt(self, name: str, address: str) -> Iterator[None]:
        """Try a password in the block; Denied if too many wait, or after too many failures."""
        with self._trying.slot():
            wait_s = self.begin(name, address)
            if wait_s > 0.0:
                seconds = str(math.ceil(wait_s))
                raise Denied(
                    429,
                    f"too many failed logins; try again in {seconds} s",
                    {"Retry-After": seconds},
                )
            yield

    def begin(self, name: str, address: str) -> float:
        """Count an attempt as failed, or return the time until the next one is allowed, in s."""
        # Counted before its password is checked, so that simultaneous attempts are limited too.
        now_s = self._now_s()
        with self._lock:
            limits = self._limits(name, address)
            wait_s = max(self._locked_until_s.get(key, 0.0) - now_s for key in limits)
            if wait_s > 0.0:
                return wait_s
            for key, allowed in limits.items():
                count, last_s = self._failures.pop(key, (0, now_s))
                count = 1 if now_s - last_s > _PAUSE_S else count + 1
                if count < allowed:
                    _put_newest(self._failures, key, (count, now_s))
                else:
                    self._locked_until_s.pop(key, None)
                    _put_newest(self._locked_until_s, key, now_s + _PAUSE_S)
            return 0.0

    def succeeded(self, name: str, address: str) -> None:
        """Do not count the last attempt as a failure; forget the failures of its name."""
        with self._lock:
            for key, allowed in self._limits(name, address).items():
                was_locked = self._locked_until_s.pop(key, None) is not None
                # An attempt that locked the key has removed its count, which was `allowed`.
                count, last_s = self._failures.pop(key, (allowed if was_locked else 1, 0.0))
                if key[0] == "address" and count > 1:
                    last_s = self._now_s() if was_locked else last_s
                    _put_newest(self._failures, key, (count - 1, last_s))
            self._logged_in.pop(("both", name, address), None)
            _put_newest(self._logged_in, ("both", name, address), None)

    def unrecorded(self) -> int | None:
        """Return the failures since the last row and reset them; None if this one gets no row."""
        now_s = self._now_s()
        with self._lock:
            is_full = len(self._recorded_s) == _MAX_RECORDED
            if is_full and now_s - self._recorded_s[0] < _RECORDED_S:
                self._unrecorded += 1
                return None
            self._recorded_s.append(now_s)
            count, self._unrecorded = self._unrecorded, 0
            return count

    def _limits(self, name: str, address: str) -> dict[_Key, int]:
        """Keys under which an attempt is counted, with the number of failures that locks each."""
        name = name[:_COUNTED_LETTERS]
        both = ("both", name, address)
        if both in self._logged_in:
            return {both: FAILURES_OF_A_NAME}
        return {
            ("name", name, ""): FAILURES_OF_A_NAME,
            ("address", "", address): FAILURES_OF_AN_ADDRESS,
        }


def _put_newest(values: dict[_Key, _T], key: _Key, value: _T) -> None:
    """Add a value as the newest one, and forget the oldest beyond `_MAX_KEYS`."""
    values[key] = value
    while len(values) > _MAX_KEYS:
        del values[next(iter(values))]
