"""Time the real cycle of a station on this machine, with stored sets in place of a camera.

The sets are captured first, because a simulated camera would compete with the judge.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from capture.acquisition.attempts import capture_set
from capture.acquisition.light_checks import check_set
from capture.base.process_settings import configure_station_process, resident_bytes
from capture.sets.captured_set import PLANAR, CapturedSet
from capture.sets.image_checks import CheckedImages
from capture.sets.ome_tiff import PixelHash
from capture.station.domain.config import StationConfig
from capture.station.domain.recipe import Recipe
from capture.station.domain.taught import Taught, TaughtSet, TaughtTexture, TextureModels
from capture.station.domain.verdict import Decision
from capture.station.judge.inspector import Inspector
from capture.station.judge.judge import STOP_LED_LEVEL
from capture.station.judge.measured_surface import MeasuredSurface
from capture.station.results.store import open_store
from classify import Calibration, TextureLibrary, learn_defects
from classify.base.durable_file import make_folder
from classify.base.threads import on_free_processor
from classify.classifiers.joint import ring_means
from classify.defects.learning import MIN_PARTS
from classify.library.training import TrainingRow, observe
from classify.methods import default_method
from classify.pieces.features import band_moments
from classify.pieces.learning import GoodPart, learn_pieces
from classify.texture.spectra import segment_for
from rig import Placement, Rig, RigConfig, open_rig
from rig.doctor.check import Check
from rig.set_file import pages

from .cycle import Station
from .equipment import Equipment
from .events import PartAnnounced
from .live_station import LiveStation
from .live_view import LiveEvent
from .outcome import PartJudge
from .station_clock import StationClock
from .station_rig import StationRig
from .triggers import TimerTrigger

# Ambient image and four light images, at 30 frames per second.
_EXPOSURES_S = 5 / 30.0
# Pages in the order of their capture: the ambient image, then pairs of opposite lights.
_CAPTURE_ORDER = (4, 0, 2, 1, 3)
_GOOD, _OTHER = "rock", "sand"
# Distance of patches on the simulated surface, larger than any frame that is tried.
_STEP_PX = 1500.0
# Sets that stay in the folder, for pictures of the last parts; a thousand parts would write 10 GB.
_KEPT_SETS = 16
_NO_HASH = "0" * 64


@dataclass(frozen=True)
class _BenchResult:
    """Times, memory and verdicts of a bench."""

    # From the end of the last exposure to the announced result, of each part.
    latencies_ms: tuple[float, ...]
    # Duration of each step for each part; a set is saved while the part is inspected.
    steps_ms: dict[str, tuple[float, ...]]
    duration_s: float  # with `_EXPOSURES_S` for the exposures of each part
    # Resident, after a tenth of the parts and after all; None where it cannot be read.
    memory_mb: tuple[float, float] | None
    decisions: dict[str, int]

    def percentile_ms(self, percent: float) -> float:
        """Return a percentile of the latencies."""
        return float(np.percentile(self.latencies_ms, percent))

    def step_percentiles_ms(self, percent: float) -> dict[str, float]:
        """Return a percentile of the durations of each step."""
        return {name: float(np.percentile(ms, percent)) for name, ms in self.steps_ms.items()}

    @property
    def parts_per_minute(self) -> float:
        """Parts per minute; the exposures of each take `_EXPOSURES_S`."""
        return 60.0 * len(self.latencies_ms) / self.duration_s

    def lines(self) -> list[str]:
        """Return the result, one finding a line."""
        slow_steps_ms = self.step_percentiles_ms(99)
        median_ms, slow_ms = self.percentile_ms(50), self.percentile_ms(99)
        decisions = ", ".join(f"{count} {name}" for name, count in self.decisions.items())
        return [
            f"last exposure to announced result: p50 {median_ms:.0f} ms, p99 {slow_ms:.0f} ms",
            *(
                f"  {name:8} p50 {step_ms:.0f} ms, p99 {slow_steps_ms[name]:.0f} ms"
                for name, step_ms in self.step_percentiles_ms(50).items()
            ),
            f"{self.parts_per_minute:.0f} parts a minute, exposed {1e3 * _EXPOSURES_S:.0f} ms each",
            f"verdicts on {len(self.latencies_ms)} parts: {decisions}",
            *(
                f"memory {memory:.0f} MB after {share} of the parts"
                for memory, share in zip(self.memory_mb or (), ("a tenth", "all"), strict=False)
            ),
        ]


@dataclass
class _Watcher:
    """Collects results, and memory after a tenth of the parts."""

    parts: int
    announced: list[PartAnnounced] = field(default_factory=list)
    early_mb: float | None = None

    def __call__(self, live: LiveEvent) -> None:
        if isinstance(live.event, PartAnnounced):
            self.announced.append(live.event)
            if len(self.announced) == max(1, self.parts // 10):
                self.early_mb = _memory_mb()


class _StoredSets(StationRig):
    """A rig that delivers stored sets, in the time that their exposures would take."""

    def __init__(
        self, config: StationConfig, inspector: Inspector, sets: Sequence[CapturedSet]
    ) -> None:
        super().__init__(config, RigConfig(), inspector)
        self._sets, self._exposed = sets, inspector.begin

    def open(self) -> None:
        """Do nothing: there is no device."""

    def test(self, *, is_start: bool) -> list[Check]:  # noqa: ARG002 - as a rig has it
        """Return no checks."""
        return []

    @on_free_processor()
    def capture(self, number: int) -> tuple[CapturedSet, float]:
        """Return the next set after the time of its exposures and the checks of a capture."""
        captured, hashed = self._sets[number % len(self._sets)], PixelHash()
        planes = pages(captured.images, captured.ambient, None)
        for page in _CAPTURE_ORDER:
            time.sleep(_EXPOSURES_S / len(_CAPTURE_ORDER))
            exposed_s = time.monotonic()
            hashed.add(page, planes[page])
        self._exposed(captured)
        _check_as_captured(captured)
        hashed.sha256()
        return captured, exposed_s


def _check_as_captured(captured: CapturedSet) -> None:
    assert captured.ambient is not None
    lighting, full_scale = captured.lighting, captured.metadata.full_scale
    names = [f"LED {light}" for light in range(len(lighting))]
    images = CheckedImages(
        captured.images, captured.ambient, captured.ambient, lighting, names, full_scale,
        captured.noise,
    )  # fmt: skip
    check_set(images, Calibration(), lambda: captured.images)


def run_bench(
    folder: Path,
    parts: int,
    side_px: int,
    classes: int,
    show_step: Callable[[str], None] = lambda _: None,
    live: LiveStation | None = None,
) -> _BenchResult:
    """Judge `parts` parts of 16 bit, by `classes` classes and a defect map.

    `folder` is empty and on the disk that is measured.
    """
    show_step("capturing parts")
    good, other = _captured(side_px)
    show_step("teaching")
    inspector = _inspector(good, other, classes)
    inspector.inspect(good[-1])  # kernels are loaded before the clock runs
    watcher, clock = _Watcher(parts), StationClock()
    config = StationConfig(name="bench", recipe=_GOOD, trigger="timer", timer_s=0.0)
    written: list[Path] = []

    def save(captured: CapturedSet, set_file: str) -> None:
        written.append(folder / set_file)
        make_folder(written[-1].parent)
        captured.save(written[-1])
        if len(written) > _KEPT_SETS:
            written.pop(0).unlink()

    show_step("judging parts")
    configure_station_process()
    live = live or LiveStation(config.name, simulated=True)
    with (
        open_store(str(folder / "results.sqlite"), config.name, create=True) as store,
        live.telling(watcher),
    ):
        judge = PartJudge(config.name, None, inspector, {}, save, clock)
        camera = _StoredSets(config, inspector, good[MIN_PARTS:])
        equipment = Equipment(camera, judge, store, list, clock, live)
        began_s = time.monotonic()
        Station(folder, config, equipment, parts).run(TimerTrigger(0.0))
        duration_s = time.monotonic() - began_s
    late_mb, early_mb = _memory_mb(), watcher.early_mb
    results = [event.result for event in watcher.announced]
    return _BenchResult(
        latencies_ms=tuple(event.latency_ms for event in watcher.announced),
        steps_ms=_steps_ms(watcher.announced),
        duration_s=duration_s,
        memory_mb=None if late_mb is None or early_mb is None else (early_mb, late_mb),
        decisions={
            decision: count
            for decision in Decision
            if (count := sum(result.verdict.decision is decision for result in results))
        },
    )


def _steps_ms(announced: Sequence[PartAnnounced]) -> dict[str, tuple[float, ...]]:
    times = [event.result.timings_ms for event in announced]
    names = ("checks", "solve", "match", "defects", "inspect", "save")
    steps = {
        name: tuple(durations[name] for durations in times if name in durations) for name in names
    }
    steps["record"] = tuple(
        event.latency_ms - durations["checks"] - max(durations["inspect"], durations["save"])
        for event, durations in zip(announced, times, strict=True)
        if {"checks", "inspect", "save"} <= durations.keys()
    )
    return {name: ms for name, ms in steps.items() if ms}


def _captured(side_px: int) -> tuple[list[CapturedSet], CapturedSet]:
    """Parts of one texture to teach and one more to judge; and one part of another texture."""
    camera = {"width_px": side_px, "height_px": side_px, "bits": 16}
    with open_rig(RigConfig().with_changes(camera=camera)) as rig:
        good = [_placed(rig, _GOOD, number) for number in range(MIN_PARTS + 2)]
        return good, _placed(rig, _OTHER, 0)


def _placed(rig: Rig, surface: str, number: int) -> CapturedSet:
    assert rig.simulation is not None
    rig.simulation.place(Placement(surface=surface, shift_px=(number * _STEP_PX, 0.0)))
    return capture_set(rig, label=surface)


def _inspector(good: Sequence[CapturedSet], other: CapturedSet, classes: int) -> Inspector:
    """An inspector whose library has `classes` classes; all but one look like `other`."""
    surfaces = [
        MeasuredSurface.of(captured, None, None, None) for captured in (*good[:MIN_PARTS], other)
    ]
    segment_px = segment_for(surfaces[0].surface.shape)
    first, last = (
        observe(measured.surface, segment_px) for measured in (surfaces[0], surfaces[-1])
    )
    rows = [TrainingRow(_GOOD, first)]
    rows += [TrainingRow(f"{_OTHER} {number}", last) for number in range(1, classes)]
    library = TextureLibrary.from_observations(
        rows, segment_px, method=default_method(len(good[0].images)), planar=PLANAR
    )
    taught_surfaces = [measured.surface for measured in surfaces[:MIN_PARTS]]
    rings = [ring_means(library.observe(surface)) for surface in taught_surfaces]
    parts = [
        GoodPart(band_moments(surface), 0.0, levels)
        for surface, levels in zip(taught_surfaces, rings, strict=True)
    ]
    model = TextureModels(
        learn_defects(taught_surfaces, [0.0] * MIN_PARTS),
        learn_pieces(parts, np.ones_like(rings[0])),
    )
    texture = TaughtTexture(
        sets=(TaughtSet(file="bench.ome.tif", pixels_sha256=_NO_HASH),),
        light_signals=surfaces[0].light_signals,
        least_led_level=STOP_LED_LEVEL,
        tilt_errors_deg=(0.0, 0.0),
    )
    taught = Taught(
        setting=good[0].setting,
        has_calibration=False,
        library_sha256=_NO_HASH,
        textures={_GOOD: texture},
    )
    return Inspector(Recipe(name=_GOOD, passes=(_GOOD,)), taught, library, {_GOOD: model})


def _memory_mb() -> float | None:
    resident = resident_bytes()
    return None if resident is None else resident / 1e6
