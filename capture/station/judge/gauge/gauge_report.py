"""`GaugeReport`: last gauge study of a recipe, as a JSON file in its folder."""

from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Literal, Self

from pydantic import Field

from capture.base.utc_time import utc_text
from capture.station.domain.recipe import Sha256
from classify.base.models import Record

from .gauge import GaugeStudy, Rating, Share

_MAX_BYTES = 1 << 22  # the reasons of 200 parts, 2,000 characters each, have 0.4 MB
# Number of parts with a wrong verdict that a report names.
_MAX_WRONG_ROWS = 200


class GaugeReport(Record):
    """What a gauge study found."""

    format: Literal["ps4rig-gauge"] = "ps4rig-gauge"
    version: Literal[1] = 1
    utc: str  # end of the study
    software_version: str = Field(default_factory=lambda: version("ps4rig"))
    recipe: str
    recipe_sha256: Sha256 | None  # None for results of an earlier run
    simulated: bool
    presentations: int
    effectiveness: Share  # `effectiveness` to `rating`: as in `GaugeStudy`
    misses: Share
    false_alarms: Share
    rating: Rating
    lines: tuple[str, ...]  # of `GaugeStudy`, then of `FaultStudy`
    wrong: tuple[str, ...]  # `GaugeStudy.wrong_verdicts`, of the first parts

    @classmethod
    def of(
        cls,
        study: GaugeStudy,
        recipe: str,
        recipe_sha256: str | None,
        *,
        simulated: bool,
        faults: Sequence[str] = (),
    ) -> Self:
        """Return the report of a study that has just ended; `faults` are lines of a FaultStudy."""
        return cls(
            utc=utc_text(timespec="seconds"),
            recipe=recipe,
            recipe_sha256=recipe_sha256,
            simulated=simulated,
            presentations=len(study.presentations),
            effectiveness=study.effectiveness,
            misses=study.misses,
            false_alarms=study.false_alarms,
            rating=study.rating,
            lines=(*study.lines(), *faults),
            wrong=tuple(study.wrong_verdicts()[:_MAX_WRONG_ROWS]),
        )


def read_gauge_report(path: Path) -> GaugeReport | None:
    """Read the report of a recipe; None if no study was made."""
    if not path.exists():
        return None
    return GaugeReport.read(path, _MAX_BYTES, "run ps4rig station gauge")
