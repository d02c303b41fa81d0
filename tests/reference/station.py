"""The page of the station: states and registers."""

from capture.station.cycle.states import transitions_table
from capture.station.plc.registers import registers_page


def station_page() -> str:
    """Return the page as Markdown."""
    return "\n".join(
        [
            "# Station",
            "",
            "## States",
            "",
            transitions_table(),
            "",
            "## Registers of the PLC",
            "",
            registers_page(),
        ]
    )
