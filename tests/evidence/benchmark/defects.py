"""Time of a defect map, and of learning from good parts."""

from functools import partial

from capture.chapter.results import shortest_ms
from classify import learn_defects

from .measurements import Measurement, Section
from .scenes import rotated_patch

# The share of the defect map in the 120 ms of a part at a station, by side of the frame.
_TARGETS_MS = {1024: 25.0}
_TEXTURE = "sand"
_ORIENTATIONS_DEG = (0.0, 50.0, 110.0)


def defects_section(size_px: int, rounds: int) -> Section:
    """Time `learn_defects` and `DefectModel.map_of` in frames of side `size_px`."""
    surfaces = [
        rotated_patch(_TEXTURE, seed, size_px, orientation_deg).solve()
        for seed, orientation_deg in enumerate(_ORIENTATIONS_DEG)
    ]
    learn = partial(learn_defects, surfaces, _ORIENTATIONS_DEG)
    map_part = partial(learn().map_of, surfaces[-1], _ORIENTATIONS_DEG[-1])
    times = shortest_ms({"map": map_part}, rounds) | shortest_ms({"learning": learn}, 1)
    return Section(
        f"Defect map, {size_px} x {size_px}",
        [
            Measurement("map of a part", times["map"], "ms", target=_TARGETS_MS.get(size_px)),
            Measurement(f"learning from {len(surfaces)} parts", times["learning"], "ms"),
        ],
        (f"The shortest of {rounds} calls after a first one; {_TEXTURE}.",),
    )
