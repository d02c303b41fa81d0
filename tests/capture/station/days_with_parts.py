"""Folders of days, as the parts of a running station make them."""

from datetime import datetime, timedelta
from pathlib import Path


def make_days(folder: Path, until: datetime, days: int = 5) -> None:
    """Make the folders of the last days in a station."""
    for days_ago in range(days):
        day = (until - timedelta(days=days_ago)).date().isoformat()
        (folder / "parts" / day).mkdir(parents=True, exist_ok=True)
