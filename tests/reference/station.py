"""The page of the station: states and registers."""

from capture.station.line.registers import registers_page
from capture.station.run.states import transitions_table


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
