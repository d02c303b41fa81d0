"""``ps4rig info``."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from capture.base.console import out, print_json, reported
from classify.base.errors import InputError

from . import options

if TYPE_CHECKING:
    from capture.sets.captured_set import CapturedSet
    from capture.sets.metadata import SetMetadata

_NOT_KNOWN = "-"
_NAME_WIDTH = 14


@reported
def info(
    sets: options.Sets,
    corrections: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            help="Correct label, specimen, operator, note, orientation_deg or properties.NAME. The "
            "pixels stay as they are, and a dated entry keeps the value from before. Repeat the "
            "option for more.",
            metavar="FIELD=VALUE",
        ),
    ] = None,
    json: options.Json = False,
) -> None:
    """Show the origin of captured sets, or correct their label and description."""
    from capture.session.corrections import correct_in_sessions
    from capture.sets.archive import find_sets
    from capture.sets.captured_set import CapturedSet

    paths = find_sets(sets)
    if corrections:
        values = dict(_correction(text) for text in corrections)
        correct_in_sessions(paths, lambda: _correct(paths, values))
    rows = []
    for path in paths:
        captured = CapturedSet.load(path)
        if json:
            rows.append(_as_json(path, captured))
            continue
        out.print(str(path))
        for name, value in _lines(captured):
            out.print(f"  {name:<{_NAME_WIDTH}} {value}")
    if json:
        print_json(rows)


def _correction(text: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not equals:
        raise InputError(f"--set {text}: give FIELD=VALUE, such as --set note='edge is worn'")
    return name.strip(), value.strip()


def _correct(paths: list[Path], values: dict[str, str]) -> None:
    from capture.sets.captured_set import CapturedSet
    from capture.sets.description import corrected
    from capture.sets.ome_tiff import read_header

    now = datetime.now(UTC)
    # All corrections are checked before the first is written.
    metadata = {}
    for path in paths:
        before, _ = read_header(path)
        try:
            metadata[path] = corrected(before, values, now)
        except InputError as error:
            raise InputError(f"{path}: {error}") from error
    options.check_orientations(
        "orientation_deg", *{changed.orientation_deg for changed in metadata.values()}
    )
    for path, changed in metadata.items():
        replace(CapturedSet.load(path), metadata=changed).save(path)


def _as_json(path: Path, captured: CapturedSet) -> dict[str, Any]:
    rows, columns = captured.images.shape[1:]
    size = {"width_px": columns, "height_px": rows}
    return {"set": str(path), **size, **captured.metadata.model_dump(mode="json")}


def _lines(captured: CapturedSet) -> Iterator[tuple[str, str]]:
    from capture.sets.description import plain

    metadata = captured.metadata
    rows, columns = captured.images.shape[1:]
    for name in ("label", "specimen", "operator", "note"):
        yield name, getattr(metadata, name) or _NOT_KNOWN
    for name, value in metadata.properties.items():
        yield "property", f"{name} = {plain(value)}"
    yield "orientation", _number(metadata.orientation_deg, "degrees")
    yield from metadata.facts
    yield (
        "images",
        f"{len(captured.images)} lights"
        + ("" if captured.ambient is None else " and ambient light"),
    )
    yield "size", f"{columns} x {rows} px, {metadata.bit_depth} bit, full {metadata.full_scale}"
    yield (
        "lights",
        ", ".join(
            f"tilt {tilt:g} slant {slant:g} level {level:g}"
            for tilt, slant, level in zip(
                captured.lighting.tilts_deg.round(1) % 360.0,
                captured.lighting.slants_deg.round(1),
                captured.lighting.intensities.round(3),
                strict=True,
            )
        ),
    )
    yield from _rig_lines(metadata)
    yield "calibration", ", ".join(metadata.calibration_ids) or "none"
    if metadata.mm_per_px is not None:
        yield "scale", f"{metadata.mm_per_px:.4g} mm/px"
    for warning in metadata.warnings:
        yield "warning", warning
    for cause in metadata.accepted:
        yield "accepted", cause
    for entry in metadata.corrections:
        before, after = (
            _NOT_KNOWN if value is None else plain(value) for value in (entry.before, entry.after)
        )
        yield "corrected", f"{entry.corrected_utc} {entry.field}: {before} -> {after}"
    yield "software", f"ps4rig {metadata.software_version}, schema {metadata.schema_version}"
    yield "pixels", f"SHA-256 {metadata.pixels_sha256}"


def _rig_lines(metadata: SetMetadata) -> Iterator[tuple[str, str]]:
    """What is known of the rig, or of the photographs that were imported."""
    if metadata.rig_name is not None:
        yield "rig", metadata.rig_name
    if metadata.camera is not None:
        camera = metadata.camera
        yield "camera", f"{camera.name} ({camera.kind}), {camera.exposure_ms:g} ms exposure"
    if metadata.controller is not None:
        board = metadata.controller
        yield "controller", f"{board.model} {board.serial_number}, {board.firmware_version}"
    files = [image.source_file for image in metadata.images if image.source_file]
    if files:
        yield "photographs", f"{', '.join(files)}; response {metadata.gamma}"
    checks = metadata.checks
    if checks is not None:
        order = f"light order {checks.light_order}"
        yield "checks", order + (", agrees with a retake" if checks.retaken else "")
        if checks.light_levels is not None:
            yield "LED levels", ", ".join(f"{level:.3f}" for level in checks.light_levels)
    for reason in metadata.failed_attempts:
        yield "failed attempt", reason


def _number(value: float | None, unit: str) -> str:
    return _NOT_KNOWN if value is None else f"{value:g} {unit}"
