"""Commands that look at files: info, verify, compare."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from capture.base.console import out, print_json, progress
from capture.base.outputs import check_output
from capture.commands import options
from classify.base.errors import InputError

if TYPE_CHECKING:
    from capture.maps.comparison import Comparison
    from capture.session.verification import FileFinding
    from capture.sets.captured_set import CapturedSet
    from capture.sets.metadata import SetMetadata

_NOT_KNOWN = "-"
_NAME_WIDTH = 14  # of the column of names, in characters


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
    from capture.session.measures import correct_in_sessions
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
    metadata = captured.metadata.model_dump(mode="json")
    return {"set": str(path), "width_px": columns, "height_px": rows, **metadata}


def _lines(captured: CapturedSet) -> Iterator[tuple[str, str]]:
    from capture.sets.description import exact_value

    metadata = captured.metadata
    rows, columns = captured.images.shape[1:]
    for name in ("label", "specimen", "operator", "note"):
        yield name, getattr(metadata, name) or _NOT_KNOWN
    for name, value in metadata.properties.items():
        yield "property", f"{name} = {exact_value(value)}"
    degrees = metadata.orientation_deg
    yield "orientation", _NOT_KNOWN if degrees is None else f"{degrees:g} degrees"
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
            _NOT_KNOWN if value is None else exact_value(value)
            for value in (entry.before, entry.after)
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


def verify(
    folders: Annotated[
        list[Path], typer.Argument(metavar="DIR...", help="Folders, with all folders below.")
    ],
    json: options.Json = False,
    head: Annotated[
        str | None,
        typer.Option(
            "--head",
            metavar="SHA256",
            help="A hash of a station's chain that was kept elsewhere; it must still be in it.",
        ),
    ] = None,
) -> None:
    """Check that sets, libraries, calibrations, sessions and stations are whole and unaltered.

    Every file is read and hashed anew, and the sets of a station are compared with its results,
    which form a chain of hashes. Who can write to the database can make the whole chain anew:
    --head finds that. Libraries and models have a hash in their file, which a recipe names. The
    exit status is 1 if something is missing, altered, without its calibration, or of a schema
    without a hash.
    """
    from capture.session.verification import files_below, verify_file
    from capture.station.domain.config import CONFIG

    paths = [path for folder in folders for path in files_below(folder, CONFIG)]
    findings: list[FileFinding] = []
    for path in progress(paths, len(paths), "verify"):
        if path.name == CONFIG:
            from capture.station.results.verification import verify_station

            findings += verify_station(path.parent, head)
        else:
            findings += verify_file(path)
    bad_findings = [finding for finding in findings if finding.state != "good"]
    if json:
        print_json(
            {
                "files": len(paths),
                "findings": [
                    {"path": str(finding.path), "state": finding.state, "said": finding.details}
                    for finding in bad_findings
                ],
            }
        )
    else:
        for finding in bad_findings:
            out.print(f"{finding.path}: {finding.state}: {finding.details}")
        counts = Counter(finding.state for finding in findings)
        summary = ", ".join(f"{count} {state}" for state, count in sorted(counts.items()))
        out.print(f"files: {summary}")
    if bad_findings:
        raise typer.Exit(1)


_PAGE_SUFFIX = ".html"


def compare(
    first: Annotated[
        Path, typer.Argument(metavar="A", help="A captured set, or a folder of maps from solve.")
    ],
    second: Annotated[Path, typer.Argument(metavar="B", help="Another one.")],
    output: Annotated[
        Path | None,
        typer.Option(
            "--out", metavar="PAGE.html", help="The page.", show_default="none, or comparison.html"
        ),
    ] = None,
    calibration: options.CalibrationOfSet = None,
    raw: options.Raw = False,
    force: options.Force = False,
    json: options.Json = False,
) -> None:
    """Compare two sets or folders of maps: maps side by side, distance and angle, what differs.

    Differences pixel by pixel are given where both have one size. With --json no page is written
    without --out.
    """
    from capture.maps.comparison import compare as compared
    from capture.maps.comparison import comparison_page, side_of
    from classify.base.durable_file import write_text

    options.check_calibration(calibration, raw)
    if (raw or calibration is not None) and first.is_dir() and second.is_dir():
        raise InputError(
            f"{first} and {second}: are solved already; leave out --calibration and --raw"
        )
    page = output if output is not None or json else Path(f"comparison{_PAGE_SUFFIX}")
    if page is not None:
        check_output(page, suffix=_PAGE_SUFFIX, inputs=[first, second], force=force)
    comparison = compared(*(side_of(path, calibration, raw=raw) for path in (first, second)))
    if page is not None:
        write_text(page, comparison_page(comparison))
    if json:
        print_json(comparison.as_json())
        return
    _print(comparison)
    out.print(f"{page}: maps side by side")


def _print(comparison: Comparison) -> None:
    texture, angle_text = comparison.texture, comparison.angle_text
    if texture is None:
        out.print("texture: not compared: a side is too small, or has no valid pixel")
    else:
        angle = "no clear angle" if angle_text is None else f"{angle_text} degrees"
        out.print(f"texture: distance {texture.distance:.2f}, {angle} from A to B")
    if comparison.normals_deg is not None and comparison.is_aligned:
        median, p95 = comparison.normals_deg
        out.print(f"normals: median {median:.3g} degrees apart, 95 % within {p95:.3g}")
    for name, difference in comparison.maps.items() if comparison.is_aligned else ():
        unit = f" {difference.unit}" if difference.unit else ""
        out.print(f"{name}: B - A has mean {difference.mean:.3g}, rms {difference.rms:.3g}{unit}")
    if comparison.maps and not comparison.is_aligned:
        out.print("the part was moved, or another one: pixels do not belong together")
    for field, first, second in comparison.fields:
        out.print(f"{field}: {first} -> {second}")
