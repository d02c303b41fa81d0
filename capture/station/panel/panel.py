"""`Panel`: the objects that all pages and API calls work with."""

import threading
from collections import defaultdict

from capture.station.domain.folder import StationFolder
from capture.station.domain.interface_config import PanelConfig
from capture.station.domain.users import Tokens, Users
from capture.station.results.audit import ResultsAccess
from capture.station.run.live_view import Subscription

from .background_jobs import BackgroundJobs
from .part_pictures import PictureMaker
from .security import Slots
from .sessions import LoginLimit, Sessions
from .station_link import StationLink
from .triggering import KeyedTriggers

# Exports and statistics: of a million parts each takes seconds, in one of the 40 threads that
# serve requests.
MAX_RECKONING = 3
# The server takes 256 connections: some stay free for other requests.
_MAX_STREAMS = 128


class Panel:
    """The objects that all pages and API calls work with."""

    def __init__(self, folder: StationFolder, live: StationLink, settings: PanelConfig) -> None:
        self.folder, self.live = folder, live
        self.settings = settings  # section ``[panel]``, with what the command line changed
        self.results = ResultsAccess(folder, live.append)
        self.users, self.tokens = Users(folder.path), Tokens(folder.path)
        self.sessions = Sessions(folder.path, self.users)
        self.triggers = KeyedTriggers(live, self.results)
        self.pictures = PictureMaker(folder)
        self.jobs, self.logins = BackgroundJobs(), LoginLimit()
        # The event streams of each account and client, the oldest first.
        self.streams: defaultdict[tuple[str, str], list[Subscription]] = defaultdict(list)
        self.reckoning = Slots(MAX_RECKONING, "exports or statistics")
        self.event_streams = Slots(_MAX_STREAMS, "event streams are open")
        # Held by an override or acknowledgement, so that a second click finds the first done.
        self.changing = threading.Lock()
