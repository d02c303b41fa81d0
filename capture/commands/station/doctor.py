"""``ps4rig station doctor``."""

from capture.commands import options
from capture.commands.checks import print_checks
from capture.console import reported

from .teach import Station


@reported
def doctor(folder: Station, as_json: options.Json = False) -> None:
    """Check everything that a station needs: recipe, challenge, calibration, results, disk, rig.

    The exit status is 1 if there is a fault.
    """
    from capture.station.diagnosis import diagnose_station

    print_checks(list(diagnose_station(folder)), as_json=as_json)
