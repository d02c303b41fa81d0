"""``ps4rig demo``: the whole job on the simulated rig."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from capture.acquisition.attempts import capture_set
from capture.console import new_table, out, print_table, progress
from capture.sets.captured_set import CapturedSet
from capture.sets.ome_tiff import SUFFIX
from classify import (
    Spectra,
    TextureLibrary,
    Trial,
    evaluate,
    surface_spectra,
)
from classify.durable_file import make_folder
from rig import Placement, Rig, RigConfig, open_rig, surface_names

from .report import ANGLE_NOTE, ReportEntry, write_report

__all__ = ["run_demo"]

FRAME_PX = 256
TEST_SEED = 1000


@dataclass(frozen=True)
class _TestPlacement:
    """Another patch of the surface, turned. It shares a corner with the learned one at most."""

    rotate_deg: float
    shift_px: tuple[float, float]


_TESTS = (_TestPlacement(37.0, (256.0, 120.0)), _TestPlacement(112.0, (-100.0, 256.0)))


def run_demo(output: Path) -> None:
    """Capture, train and classify on the simulated rig, and write the report into a folder.

    Raises
    ------
    InputError
        If the folder cannot be made or written to.
    """
    names = surface_names()
    sets_folder = output / "sets"
    for folder in (output, sets_folder):
        make_folder(folder)
    config = RigConfig().with_changes(camera={"width_px": FRAME_PX, "height_px": FRAME_PX})
    out.print("Simulated rig: no light, camera or part of this demo is real.")
    with open_rig(config) as rig:
        identity = rig.lights.identity
        out.print(
            f"Light controller {identity.model} {identity.serial_number}, firmware "
            f"{identity.firmware_version}, on {rig.lights.port}; camera {rig.camera.info.name}, "
            f"{FRAME_PX} x {FRAME_PX} px, {rig.camera.info.bit_depth} bit."
        )
        placements = [Placement(surface=name, seed=index) for index, name in enumerate(names)]
        trained = list(
            progress(_captured(rig, placements, sets_folder, "train"), len(names), "train")
        )
        placements = [
            Placement(
                surface=name,
                rotate_deg=test.rotate_deg,
                shift_px=test.shift_px,
                seed=TEST_SEED + index,
            )
            for index, name in enumerate(names)
            for test in _TESTS
        ]
        tests = list(
            progress(_captured(rig, placements, sets_folder, "test"), len(placements), "test")
        )
    surfaces = {captured.metadata.label or "": captured.solve() for captured in trained}
    samples = ((label, surface, 0.0) for label, surface in surfaces.items())
    library = replace(TextureLibrary.train(samples), simulated=True)
    library.save(output / "textures.ps4lib")
    references = {
        label: surface_spectra(surface, library.segment_px) for label, surface in surfaces.items()
    }
    entries = list(progress(_entries(tests, library, references), len(tests), "classify"))
    trials = [Trial(entry.label, entry.orientation_deg, entry.match) for entry in entries]
    report = output / "report.html"
    result = evaluate(trials)
    write_report(report, entries, result, identity, config)
    _print_table(trials)
    out.print(ANGLE_NOTE)
    out.print(
        f"{result.correct} of {result.sets} right. Simulated rig. "
        f"Report: {report}, sets: {sets_folder}",
        soft_wrap=True,
    )


def _captured(
    rig: Rig, placements: list[Placement], folder: Path, stem: str
) -> Iterator[CapturedSet]:
    """Lay each part below the camera, capture it, and read it back from its file."""
    for number, placement in enumerate(placements):
        if rig.simulation is not None:
            rig.simulation.place(placement)
        path = folder / f"{stem}-{number:02d}-{placement.surface}{SUFFIX}"
        capture_set(rig, label=placement.surface).save(path)
        yield CapturedSet.load(path)


def _entries(
    tests: list[CapturedSet], library: TextureLibrary, references: dict[str, Spectra]
) -> Iterator[ReportEntry]:
    for captured in tests:
        surface = captured.solve()
        match = library.classify(surface)
        yield ReportEntry(
            label=captured.metadata.label or "",
            orientation_deg=captured.metadata.orientation_deg or 0.0,
            captured=captured,
            surface=surface,
            match=match,
            spectra=surface_spectra(surface, library.segment_px),
            reference=references[match.nearest],
        )


def _print_table(trials: list[Trial]) -> None:
    table = new_table("true", "found", "true angle", "found angle", "distance", "margin")
    for trial in trials:
        match = trial.match
        table.add_row(
            trial.label,
            match.label or "unknown",
            f"{trial.orientation_deg or 0.0:.1f}",
            f"{match.orientation_deg:.1f}",
            f"{match.distance:.4f}",
            "-" if match.margin is None else f"{match.margin:.2f}",
            style=None if match.label == trial.label else "red",
        )
    print_table(table)
