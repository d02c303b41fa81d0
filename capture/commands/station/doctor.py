"""``ps4rig station doctor``."""

from capture.base.console import reported
from capture.commands import options
from capture.commands.rig.doctor import print_checks

from .teach import Station


@reported
def doctor(folder: Station, as_json: options.Json = False) -> None:
    """Check everything that a station needs.

    It checks recipe, challenge set, calibration, results, disk and rig; where systemd runs, also
    the unit of the station. The exit status is 1 if there is a fault.
    """
    from capture.station.run.diagnosis import diagnose_station
    from capture.station.service.unit_check import diagnose_unit

    print_checks([*diagnose_station(folder), *diagnose_unit(folder)], as_json=as_json)
