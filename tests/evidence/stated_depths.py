"""Strengths of defects that teaching states, beside those that a simulated camera shows.

    python -m tests.evidence.stated_depths MATERIALS [--quick] [--textures N] [--places N]

MATERIALS is a folder with one folder for each material, of which 8 are used, evenly in alphabetical
order. A defect model learns 25 good parts of 512 px, and states strengths, as teaching does. The
depth of a scratch or dent, or the contrast of a stain, that the defect map finds in 9 of 10 places
is then measured: in places of other parts each defect is captured, solved and judged in several
strengths, down to the weakest that is found. The table has the stated and the measured one, and
their ratio. `-` stands for a defect that is not found, even as strong as was tried.
"""

import argparse
import math
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from capture.sets.captured_set import PLANAR, CapturedSet, LoadedSet
from classify import DefectModel, SurfaceEstimate, TextureLibrary, learn_defects
from classify.defects.defect_map import DefectMap
from classify.defects.detectability import (
    DEFECTS,
    Detectability,
    Floats,
    KnownDefect,
    Place,
    detectability,
    is_precise,
    places_for,
    scores_at,
    stated_strength,
    threshold_strengths,
)
from rig import Placement
from rig.config.simulation import Defect

from .faulty_parts import GOOD, SIDE_PX, camera_over, kept_parts

_TAUGHT = 25
# The measured range is this factor to both sides of the stated strength, bisected this often.
_RANGE, _STEPS = 2.0, 3
# More places, where the strengths that they need differ much.
_MORE = 4
# Of a darker stain too many pixels are black, and have no slope.
_DARKEST = 0.85
# Most that a stated strength may be off.
_TOLERANCE = 0.15


def measured(
    stated: Detectability,
    capture: Callable[[Placement], CapturedSet],
    map_of: Callable[[CapturedSet], DefectMap],
    places: int,
    draw: np.random.Generator,
) -> list[float]:
    """The least strength that is found in each place; infinity beyond the range."""
    defect = stated.defect
    middle = stated.strength or defect.strongest
    strongest = middle * _RANGE
    if defect.kind == "stain":
        strongest = min(strongest, _DARKEST)
    found: list[float] = []
    while len(found) < places or (len(found) < _MORE * places and not is_precise(found)):
        here = places_for((SIDE_PX, SIDE_PX), defect, draw)
        shift_px = (float(draw.uniform(-2000.0, 2000.0)), float(draw.uniform(-2000.0, 2000.0)))
        part = Placement(rotate_deg=float(draw.uniform(0.0, 360.0)), shift_px=shift_px)

        def scores(
            strengths: Floats, here: Sequence[Place] = here, part: Placement = part
        ) -> Floats:
            defects = tuple(
                _placed(defect, place, float(strength), part)
                for place, strength in zip(here, strengths, strict=True)
            )
            seed = int(draw.integers(1, 2**31))
            shown = capture(part.model_copy(update={"seed": seed, "defects": defects}))
            return scores_at(map_of(shown).score, defect, here)

        found += threshold_strengths(scores, len(here), middle / _RANGE, strongest, _STEPS).tolist()
    return found


def _surface(captured: CapturedSet) -> SurfaceEstimate:
    """The surface of a part, even if so many defects make the station refuse its images."""
    return LoadedSet(captured, None).solve_texture(None, planar=PLANAR)


def _placed(defect: KnownDefect, place: Place, strength: float, part: Placement) -> Defect:
    """The defect in a place of the frame, on the part below it."""
    right, up = place.column - 0.5 * (SIDE_PX - 1), 0.5 * (SIDE_PX - 1) - place.row
    cos, sin = (each(math.radians(part.rotate_deg)) for each in (math.cos, math.sin))
    is_stain = defect.kind == "stain"
    return Defect(
        kind=defect.kind,
        x_px=cos * right + sin * up + part.shift_px[0],
        y_px=cos * up - sin * right + part.shift_px[1],
        size_px=defect.extent_px,
        width_px=defect.size_px,
        depth_px=1.0 if is_stain else strength,
        contrast=strength if is_stain else 0.0,
        angle_deg=math.degrees(place.angle) - part.rotate_deg,
    )


def main(arguments: Sequence[str]) -> int:
    """Print the table; return 1 if a stated strength is off by more than the tolerance."""
    parser = argparse.ArgumentParser(prog="stated_depths")
    parser.add_argument("materials", type=Path)
    parser.add_argument("--quick", action="store_true", help="every other defect")
    parser.add_argument("--textures", type=int, default=8)
    parser.add_argument("--places", type=int, default=32, help="least places of each defect")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args(arguments)
    found = sorted(each for each in given.materials.iterdir() if each.is_dir())
    chosen = [found[n * len(found) // given.textures] for n in range(given.textures)]
    kept = Path(tempfile.gettempdir()) / "ps4rig-stated-depths"
    ratios: list[float] = []
    print(f"{'texture':24} {'defect':8} {'px':>4} {'stated':>7} {'measured':>8} {'ratio':>6}")
    for material in chosen:
        draw = np.random.default_rng([given.seed, *material.name.encode()])
        paths = kept_parts(kept, material, GOOD, _TAUGHT, given.seed)
        surfaces = [_surface(CapturedSet.load(path)) for path in paths]
        library = TextureLibrary.train([(material.name, surfaces[0])])
        angles = [library.classify(each).orientation_deg for each in surfaces]
        model = learn_defects(surfaces, angles)

        def map_of(
            captured: CapturedSet,
            library: TextureLibrary = library,
            model: DefectModel = model,
        ) -> DefectMap:
            surface = _surface(captured)
            return model.map_of(surface, library.classify(surface).orientation_deg)

        order = np.random.default_rng(0).permutation(len(surfaces)).tolist()
        tried = [(surfaces[n], angles[n]) for n in order]
        known = DEFECTS[1::2] if given.quick else DEFECTS
        with camera_over(material) as capture:
            for stated in detectability(model, tried, defects=known):
                strengths = measured(stated, capture, map_of, given.places, draw)
                ratios.append(_row(material.name, stated, stated_strength(strengths)))
    off = [each for each in ratios if not abs(each - 1.0) <= _TOLERANCE]
    print(
        f"{len(ratios) - len(off)} of {len(ratios)} within {_TOLERANCE:.0%}; median ratio "
        f"{np.median(ratios):.2f}, {min(ratios):.2f} to {max(ratios):.2f}"
    )
    return int(bool(off))


def _row(texture: str, stated: Detectability, strength: float | None) -> float:
    """Print a line; return stated over measured strength."""
    if stated.strength is None:
        # Stated is that more than the strongest is needed.
        ratio = max(stated.defect.strongest / strength, 1.0) if strength else 1.0
    else:
        ratio = stated.strength / strength if strength else 0.0
    cells = ["-" if each is None else f"{each:.3g}" for each in (stated.strength, strength)]
    kind, size_px, _ = stated.defect
    print(
        f"{texture:24} {kind:8} {size_px:4.0f} {cells[0]:>7} {cells[1]:>8} {ratio:6.2f}", flush=True
    )
    return ratio


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
