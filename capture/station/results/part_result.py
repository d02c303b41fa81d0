"""`PartResult`: one row of the results, which is never changed."""

import math
from collections.abc import Iterator
from dataclasses import astuple, dataclass, field

from capture.station.verdict import Verdict

from .utc import require_utc

# Fields that are measured numbers, None where nothing was measured.
MEASURES = (
    "orientation_deg", "distance", "limit", "margin", "blur_px", "sdq", "shadow_fraction",
    "defect_score", "albedo", "scale", "handedness", "octaves", "window", "seam",
)  # fmt: skip
_MAX_INTEGER = 2**63 - 1  # of a column of both databases


@dataclass(frozen=True)
class DefectRecord:
    """An outlined defect of a part; pixels of the light images, rows downwards.

    Attributes
    ----------
    kind
        ``relief``, ``albedo`` or ``texture`` of the defect map; ``seam`` or ``window``.
    row, column, height, width
        The smallest box around it, in px.
    area_px
        Its area.
    score
        The largest score in it, in units of the recipe's threshold: 1 is the threshold.
    """

    kind: str
    row: int
    column: int
    height: int
    width: int
    area_px: int
    score: float


@dataclass(frozen=True)
class PartResult:
    """The result of one part.

    Attributes
    ----------
    station
        Name of the station.
    part_id
        Identity of the part, unique in the station: from the trigger, or made from the number.
    number
        Position in the order of triggers, from 1, without gaps within a station.
    trigger
        Source of the trigger: ``timer``, ``enter``, ``sensor``, ``http`` or ``modbus``.
    triggered_utc, exposed_utc, decided_utc
        Trigger, end of the last exposure and verdict, as in ``2026-11-22T17:08:13.042Z``;
        `exposed_utc` is None where no exposure was completed.
    verdict
        The verdict.
    operator
        Name of the operator, None if none was given.
    simulated
        Whether the set comes from a simulated rig.
    software_version
        Version of ps4rig.
    recipe, recipe_version, recipe_sha256, library_sha256, calibration_sha256
        Recipe, library and calibration that judged the part; None if not in use.
    set_file, set_sha256
        The captured set, relative to the station's folder, and the hash of its pixels; None where
        no set was captured.
    label, nearest, orientation_deg, distance, limit, margin, blur_px
        As in `classify.Match`; None where it was not matched.
    sdq, shadow_fraction
        Measured slope (ISO 25178-2) and share of shadow in the region; None where not measured.
    albedo, scale, handedness, octaves, window, seam
        As in `Limits` of a recipe; None where not measured, or for a texture without handedness.
    defect_score
        Largest score of the defect map, in units of the threshold; None without a map.
    defects
        Outlined defects, the largest score first; those of windows last.
    led_levels
        Measured level of each light against the taught one, in the order of the lights.
    timings_ms
        Duration of each step that was made: ``capture``, ``checks``, ``solve``, ``match``,
        ``defects``, ``inspect`` and ``save``.
    notes
        Remarks on the part, such as a clock that was set back.

    Raises
    ------
    ValueError
        For a value that no row can hold: NaN or infinity, an integer beyond 64 bits, a number below
        1, or a time of another form.
    """

    station: str
    part_id: str
    number: int
    trigger: str
    triggered_utc: str
    exposed_utc: str | None
    decided_utc: str
    verdict: Verdict
    operator: str | None
    simulated: bool
    software_version: str
    recipe: str | None = None
    recipe_version: int | None = None
    recipe_sha256: str | None = None
    library_sha256: str | None = None
    calibration_sha256: str | None = None
    set_file: str | None = None
    set_sha256: str | None = None
    label: str | None = None
    nearest: str | None = None
    orientation_deg: float | None = None
    distance: float | None = None
    limit: float | None = None
    margin: float | None = None
    blur_px: float | None = None
    sdq: float | None = None
    shadow_fraction: float | None = None
    defect_score: float | None = None
    albedo: float | None = None
    scale: float | None = None
    handedness: float | None = None
    octaves: float | None = None
    window: float | None = None
    seam: float | None = None
    defects: tuple[DefectRecord, ...] = ()
    led_levels: tuple[float, ...] = ()
    timings_ms: dict[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for time in (self.triggered_utc, self.exposed_utc, self.decided_utc):
            if time is not None:
                require_utc(time)
        if not 1 <= self.number <= _MAX_INTEGER or abs(self.recipe_version or 0) > _MAX_INTEGER:
            raise ValueError(
                f"number {self.number} is below 1, or it or recipe version {self.recipe_version} "
                "exceeds 64 bits"
            )
        for name, value in self._measured():
            if value is not None and not math.isfinite(value):
                raise ValueError(f"{name} of part {self.part_id} is {value}")

    def _measured(self) -> Iterator[tuple[str, float | None]]:
        yield from ((name, getattr(self, name)) for name in MEASURES)
        for defect in self.defects:
            yield from (("defects", value) for value in astuple(defect)[1:])
        yield from (("led_levels", level) for level in self.led_levels)
        yield from self.timings_ms.items()
