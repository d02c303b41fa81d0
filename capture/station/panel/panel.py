"""`Panel`: the objects that all pages and API calls work with."""

import threading
from collections import defaultdict
from dataclasses import dataclass, field

from capture.station.domain.folder import StationFolder
from capture.station.domain.interface_config import PanelConfig
from capture.station.domain.tokens import Tokens
from capture.station.domain.users import Users
from capture.station.results.audit import ChangeLog, ResultsAccess
from capture.station.run.live_station import LiveStation
from capture.station.run.live_view import Subscription

from .background_jobs import BackgroundJobs
from .part_pictures.picture_maker import PictureMaker
from .security import Slots
from .sessions import LoginLimit, Sessions
from .station_link import StationLink
from .triggering import KeyedTriggers

# Exports and statistics: of a million parts each takes seconds, in one of the 40 threads that
# serve requests.
MOST_RECKONING = 3


@dataclass(frozen=True)
class Panel:
    """The objects that all pages and API calls work with."""

    folder: StationFolder
    live: LiveStation | StationLink
    settings: PanelConfig  # section ``[panel]``, with what the command line changed
    results: ResultsAccess
    changes: ChangeLog
    users: Users
    tokens: Tokens
    sessions: Sessions
    triggers: KeyedTriggers
    pictures: PictureMaker
    jobs: BackgroundJobs = field(default_factory=BackgroundJobs)
    logins: LoginLimit = field(default_factory=LoginLimit)
    # The event streams of each account and client, the oldest first.
    streams: defaultdict[tuple[str, str], list[Subscription]] = field(
        default_factory=lambda: defaultdict(list)
    )
    reckoning: Slots = field(default_factory=lambda: Slots(MOST_RECKONING, "exports or statistics"))
    # Held by an override or acknowledgement, so that a second click finds the first done.
    changing: threading.Lock = field(default_factory=threading.Lock)

    @classmethod
    def of(
        cls, folder: StationFolder, live: LiveStation | StationLink, settings: PanelConfig
    ) -> "Panel":
        """Return the panel of a station."""
        users, results = Users(folder.path), ResultsAccess(folder)
        return cls(
            folder=folder,
            live=live,
            settings=settings,
            results=results,
            changes=ChangeLog(folder, results),
            users=users,
            tokens=Tokens(folder.path),
            sessions=Sessions(folder.path, users),
            triggers=KeyedTriggers(live, results),
            pictures=PictureMaker(folder),
        )
