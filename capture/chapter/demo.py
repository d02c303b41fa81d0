"""``ps4rig demo``: capture, train and classify on the simulated rig."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

from capture.acquisition.attempts import capture_set
from capture.base.console import (
    new_table,
    out,
    print_table,
    progress,
)
from capture.base.names import SET_SUFFIX
from capture.base.outputs import check_output
from capture.sets.captured_set import CapturedSet
from classify import (
    Spectra,
    TextureLibrary,
    Trial,
    evaluate,
    surface_spectra,
)
from classify.base.durable_file import make_folder
from rig import (
    Placement,
    Rig,
    RigConfig,
    open_rig,
    surface_names,
)

from .demo_report import (
    ANGLE_NOTE,
    COLUMNS,
    ReportEntry,
    cells_of,
    write_report,
)

_FRAME_PX = 256
# Two test patches of each surface: seed, rotation and shift. They share at most a corner with the
# training patch, which is the middle of a tile of 512 px.
_TEST_SEED = 1000
_TESTS = ((37.0, (256.0, 120.0)), (112.0, (-100.0, 256.0)))


def run_demo(output: Path, *, force: bool = False) -> None:
    """Capture, train and classify on the simulated rig, and write the report into a folder."""
    sets_folder, library_file = output / "sets", output / "textures.ps4lib"
    for folder in (output, sets_folder):
        make_folder(folder)
    surfaces = list(enumerate(surface_names()))
    training = _placed(
        sets_folder, "train", [Placement(surface=name, seed=seed) for seed, name in surfaces]
    )
    testing = _placed(
        sets_folder,
        "test",
        [
            Placement(
                surface=name, rotate_deg=rotate_deg, shift_px=shift_px, seed=_TEST_SEED + seed
            )
            for seed, name in surfaces
            for rotate_deg, shift_px in _TESTS
        ],
    )
    check_output(library_file, suffix=".ps4lib", force=force)
    for path in (*training, *testing):
        check_output(path, suffix=SET_SUFFIX, force=force)
    config = RigConfig().with_changes(camera={"width_px": _FRAME_PX, "height_px": _FRAME_PX})
    out.print("Simulated rig: no light, camera or part of this demo is real.")
    with open_rig(config) as rig:
        identity = rig.lights.identity
        out.print(
            f"Light controller {identity.model} {identity.serial_number}, firmware "
            f"{identity.firmware_version}, on {rig.lights.port}; camera {rig.camera.info.name}, "
            f"{_FRAME_PX} x {_FRAME_PX} px, {rig.camera.info.bit_depth} bit."
        )
        trained = _captured(rig, training, "train")
        tests = _captured(rig, testing, "test")
    solved = {captured.label or "": captured.solve(planar=True) for captured in trained}
    samples = ((label, surface, 0.0) for label, surface in solved.items())
    library = replace(TextureLibrary.train(samples), simulated=True)
    library.save(library_file)
    spectra = {
        label: surface_spectra(surface, library.segment_px) for label, surface in solved.items()
    }
    classified = (_classified(captured, library, spectra) for captured in tests)
    entries = list(progress(classified, len(tests), "classify"))
    trials = [entry.trial for entry in entries]
    result = evaluate(trials, library.classes)
    report = output / "report.html"
    write_report(report, entries, result, identity, config)
    table = new_table(*COLUMNS)
    for trial in trials:
        table.add_row(*cells_of(trial), style=None if trial.is_correct else "red")
    print_table(table)
    out.print(ANGLE_NOTE)
    out.print(
        f"{result.correct} of {result.sets} right. Simulated rig. "
        f"Report: {report}, sets: {sets_folder}",
    )


def _classified(
    captured: CapturedSet, library: TextureLibrary, spectra: Mapping[str, Spectra]
) -> ReportEntry:
    surface = captured.solve(planar=True)
    match = library.classify(surface)
    trial = Trial(captured.label or "", captured.metadata.orientation_deg or 0.0, match)
    own = surface_spectra(surface, library.segment_px)
    return ReportEntry(captured, surface, trial, own, spectra[match.nearest])


def _placed(folder: Path, stem: str, placements: list[Placement]) -> dict[Path, Placement]:
    """Name a file for the set of each placement."""
    return {
        folder / f"{stem}-{number:02d}-{placement.surface}{SET_SUFFIX}": placement
        for number, placement in enumerate(placements)
    }


def _captured(rig: Rig, placements: dict[Path, Placement], description: str) -> list[CapturedSet]:
    """Capture a set of each placement, save it, and read it back from its file."""

    def sets() -> Iterator[CapturedSet]:
        for path, placement in placements.items():
            if rig.simulation is not None:
                rig.simulation.place(placement)
            capture_set(rig, label=placement.surface).save(path)
            yield CapturedSet.load(path)

    return list(progress(sets(), len(placements), description))
