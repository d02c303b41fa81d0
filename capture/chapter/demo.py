"""``ps4rig demo``: capture, train and classify on the simulated rig, with an HTML report."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from markupsafe import Markup

from capture.acquisition.attempts import capture_set
from capture.base.console import new_table, out, print_table, progress
from capture.base.names import SET_SUFFIX
from capture.base.outputs import check_output
from capture.base.page import rendered
from capture.maps import pictures
from capture.maps.pictures import TILE_PX, tile_uri
from capture.sets.captured_set import CapturedSet
from classify import (
    Evaluation,
    Match,
    Spectra,
    SurfaceEstimate,
    TextureLibrary,
    Trial,
    evaluate,
    surface_spectra,
)
from classify.base.arrays import FloatMap
from classify.base.durable_file import make_folder, write_text
from classify.lighting import orientation_text
from classify.texture.orientation import MIN_SHARPNESS
from rig import ControllerIdentity, Placement, Rig, RigConfig, open_rig, surface_names

_COLUMNS = ("true", "found", "true, °", "found, °", "distance", "runner-up", "margin")

_ANGLE_NOTE = (
    "Angles are modulo 180 degrees. A question mark marks a texture with little or no direction: "
    "its angle is not reliable. A texture that looks the same after 90 degrees (Tiles036) is known "
    "modulo 90 only."
)


@dataclass(frozen=True, eq=False)
class _ReportEntry:
    """One classified set; `reference` are the spectra of the nearest training set."""

    captured: CapturedSet
    surface: SurfaceEstimate
    trial: Trial
    spectra: Spectra
    reference: Spectra


def _write_report(
    path: Path,
    entries: list[_ReportEntry],
    result: Evaluation,
    controller: ControllerIdentity,
    config: RigConfig,
) -> None:
    """Write the report as a whole or not at all."""
    page = rendered(
        "chapter/demo_report.html",
        title="ps4rig demo",
        controller=controller,
        config=config,
        result=result,
        angle_note=_ANGLE_NOTE,
        columns=_COLUMNS,
        rows=[(entry.trial.is_correct, _cells_of(entry.trial)) for entry in entries],
        is_clear=_is_clear,
        orientation_text=orientation_text,
        entries=[(entry, _tiles(entry), _polar_plots(entry)) for entry in entries],
    )
    write_text(path, page)


def _cells_of(trial: Trial) -> tuple[str, ...]:
    """Texts of a row of the table, one for each of `_COLUMNS`."""
    match = trial.match
    return (
        trial.label,
        match.label or "unknown",
        f"{trial.orientation_deg or 0.0:.1f}",
        f"{orientation_text(match.orientation_deg or 0.0, 1)}{'' if _is_clear(match) else ' ?'}",
        f"{match.distance:.4f}",
        match.runner_up or "-",
        "-" if match.margin is None else f"{match.margin:.2f}",
    )


def _is_clear(match: Match) -> bool:
    """Whether the texture has a direction that the angle can rely on."""
    return match.sharpness is not None and match.sharpness >= MIN_SHARPNESS


def _tiles(entry: _ReportEntry) -> dict[str, str]:
    maps = {
        **pictures.light_images(entry.captured, len(entry.captured.images)),
        "lights in shadow": pictures.coloured(
            entry.surface.shadow_count, pictures.shadow_colours(len(entry.captured.images))
        ),
        "albedo": pictures.grey(entry.surface.albedo),
        "relief": pictures.shaded(entry.surface.normals),
        "normals": pictures.normal_map(entry.surface.normals),
    }
    return {name: tile_uri(picture) for name, picture in maps.items()}


def _polar_plots(entry: _ReportEntry) -> dict[str, Markup]:
    orientation_deg = entry.trial.match.orientation_deg or 0.0
    return {
        name: _polar_plot(test, reference, orientation_deg)
        for name, test, reference in zip(
            ("gradient", "albedo"), entry.spectra.polar, entry.reference.polar, strict=True
        )
    }


def _polar_plot(test: FloatMap, reference: FloatMap, orientation_deg: float) -> Markup:
    """SVG: the test as a line, the training set at the orientation of the match as an area."""
    top = max(float(test.max()), float(reference.max()), 1e-12)  # not 0 for flat spectra
    return Markup(
        f'<svg viewBox="-1.1 -1.1 2.2 2.2" width="{TILE_PX}" height="{TILE_PX}">'
        '<circle r="1" class="frame"/><circle r="0.5" class="frame"/>'
        f'<polygon class="reference" points="{_points(reference / top, orientation_deg)}"/>'
        f'<polygon class="test" points="{_points(test / top, 0.0)}"/></svg>'
    )


def _points(radii: FloatMap, orientation_deg: float) -> str:
    # The spectrum covers 180 degrees; the other half is equal by point symmetry.
    count = len(radii)
    points = []
    for index in range(2 * count):
        angle = math.pi * index / count + math.radians(orientation_deg)
        radius = float(radii[index % count])
        points.append(f"{radius * math.cos(angle):.3f},{-radius * math.sin(angle):.3f}")
    return " ".join(points)


_FRAME_PX = 256
_TEST_SEED = 1000  # the noise of test sets differs from that of the training sets
# `rotate_deg` and `shift_px` of two test patches of each surface. They share at most a corner with
# the training patch, which is the middle of a tile of 512 px.
_TEST_PATCHES = ((37.0, (256.0, 120.0)), (112.0, (-100.0, 256.0)))


def run_demo(output: Path, *, force: bool = False) -> None:
    """Capture, train and classify on the simulated rig, and write the report into a folder."""
    sets_folder, library_file = output / "sets", output / "textures.ps4lib"
    for folder in (output, sets_folder):
        make_folder(folder)
    seeded_surfaces = list(enumerate(surface_names()))
    training = _by_file(
        sets_folder, "train", [Placement(surface=name, seed=seed) for seed, name in seeded_surfaces]
    )
    testing = _by_file(
        sets_folder,
        "test",
        [
            Placement(
                surface=name, rotate_deg=rotate_deg, shift_px=shift_px, seed=_TEST_SEED + seed
            )
            for seed, name in seeded_surfaces
            for rotate_deg, shift_px in _TEST_PATCHES
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
    training_spectra = {
        label: surface_spectra(surface, library.segment_px) for label, surface in solved.items()
    }
    classified = (_classified(captured, library, training_spectra) for captured in tests)
    entries = list(progress(classified, len(tests), "classify"))
    trials = [entry.trial for entry in entries]
    result = evaluate(trials, library.classes)
    report = output / "report.html"
    _write_report(report, entries, result, identity, config)
    table = new_table(*_COLUMNS)
    for trial in trials:
        table.add_row(*_cells_of(trial), style=None if trial.is_correct else "red")
    print_table(table)
    out.print(_ANGLE_NOTE)
    out.print(
        f"{result.correct} of {result.sets} right. Simulated rig. "
        f"Report: {report}, sets: {sets_folder}",
    )


def _classified(
    captured: CapturedSet, library: TextureLibrary, training_spectra: Mapping[str, Spectra]
) -> _ReportEntry:
    surface = captured.solve(planar=True)
    match = library.classify(surface)
    trial = Trial(captured.label or "", captured.metadata.orientation_deg or 0.0, match)
    test_spectra = surface_spectra(surface, library.segment_px)
    return _ReportEntry(captured, surface, trial, test_spectra, training_spectra[match.nearest])


def _by_file(folder: Path, stem: str, placements: list[Placement]) -> dict[Path, Placement]:
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
