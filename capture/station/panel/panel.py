"""`Panel`: the objects that all pages and API calls work with."""

import threading
from dataclasses import dataclass, field

from capture.station.domain.folder import StationFolder
from capture.station.domain.interface_config import PanelConfig
from capture.station.domain.tokens import Tokens
from capture.station.domain.users import Users
from capture.station.results.audit import ChangeLog, ResultsAccess
from capture.station.run.live_station import LiveStation

from .background_jobs import BackgroundJobs
from .part_pictures.picture_maker import PictureMaker
from .sessions import LoginLimit, Sessions
from .station_link import StationLink
from .triggering import KeyedTriggers


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
