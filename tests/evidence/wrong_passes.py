"""Parts with faults that a person sees at once, judged by a commissioned station.

    python -m tests.evidence.wrong_passes MATERIALS [--quick] [--good N] [--faulty N] [--seed N]
        [--only even|odd] [--local] [--causes]

MATERIALS is a folder with one folder for each material. On the first 12 in alphabetical order a
recipe is taught from 25 good parts of 512 px; other parts, captured with shadows and noise, are
then judged by the inspector. Constants were chosen on materials 1, 3, 5 ... (even, from 0);
targets hold for the others, and where a fault can be seen: stains and dents that a matched filter
finds, at a limit that 1 % of good parts exceed, holes that remove texture, seams where the texture
has a direction.
Captured sets are kept in the folder of temporary files.
"""

import argparse
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from capture.base.console import progress
from capture.sets.captured_set import CapturedSet
from capture.station.domain.recipe_file import RecipeFolder
from capture.station.domain.verdict import Decision
from capture.station.judge.inspector import Inspector
from capture.station.judge.teaching.teaching import teach
from tests.evidence.faulty_parts import FAULTS, GOOD, LOCAL, Fault, kept_parts
from tests.evidence.visibility import holes_seen, seen_by_filter

TEXTURES = 12
_TAUGHT = 25
# Most good parts that may be rejected.
_MOST_REJECTED = 0.01


class _Judged(NamedTuple):
    """A part of a material: whether it passes, and whether its fault can be seen."""

    number: int
    passes: bool
    seen: bool


def taught(material: Path, kept: Path, folder: Path, seed: int, parts: int) -> Inspector:
    """Teach a recipe from good parts, and print the remarks of teaching."""
    files = RecipeFolder(folder / material.name)
    remarks = teach(files, kept_parts(kept, material, GOOD, parts, seed)).remarks
    for remark in remarks:
        print(f"{material.name}: {remark}")
    return Inspector.load(files)


def passed(inspector: Inspector, paths: Sequence[Path], shown: list[str]) -> list[bool]:
    """Whether each part passes; `shown` gets the causes of the others."""
    passes = []
    for path in progress(paths, len(paths), path_name(paths)):
        verdict = inspector.inspect(CapturedSet.load(path)).verdict
        passes.append(verdict.decision is Decision.PASS)
        if not passes[-1]:
            shown.append(", ".join(verdict.causes))
    return passes


def path_name(paths: Sequence[Path]) -> str:
    """What the parts of these files are."""
    return paths[0].name.rpartition("-")[0] if paths else ""


def main(arguments: Sequence[str]) -> int:
    """Print the table; return 1 if a target is missed."""
    parser = argparse.ArgumentParser(prog="wrong_passes")
    parser.add_argument("materials", type=Path)
    parser.add_argument("--quick", action="store_true", help="2 textures, 10 taught parts")
    parser.add_argument("--good", type=int, default=100, help="good parts of each texture")
    parser.add_argument("--faulty", type=int, default=12, help="parts of each texture and fault")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", choices=("even", "odd"))
    parser.add_argument("--local", action="store_true", help="no changes of the whole part")
    parser.add_argument("--causes", action="store_true", help="print the causes of each row")
    given = parser.parse_args(arguments)
    found = sorted(each for each in given.materials.iterdir() if each.is_dir())[:TEXTURES]
    numbered = list(enumerate(found))
    if given.only:
        numbered = [each for each in numbered if each[0] % 2 == (given.only == "odd")]
    good, faulty, learned = given.good, given.faulty, _TAUGHT
    if given.quick:
        numbered, good, faulty, learned = numbered[2:4], 5, 2, 10
    kept = Path(tempfile.gettempdir()) / "ps4rig-wrong-passes"
    faults = (GOOD, *(each for each in FAULTS if each.kind in LOCAL or not given.local))
    rows: dict[str, list[_Judged]] = {each.name: [] for each in faults}
    for number, material in numbered:
        with tempfile.TemporaryDirectory() as folder:
            inspector = taught(material, kept, Path(folder), given.seed, learned)
            handed = inspector.recipe.limits_for(material.name).handedness is not None
            for fault in faults:
                if fault.kind == "mirrored" and not handed:
                    continue
                if fault is GOOD:
                    paths = kept_parts(kept, material, GOOD, learned + good, given.seed)[learned:]
                else:
                    paths = kept_parts(kept, material, fault, faulty, given.seed)
                causes: list[str] = []
                passes = passed(inspector, paths, causes)
                about, seen = "", [True] * len(paths)
                if fault.kind in ("stain", "dent"):
                    d_prime, seen = seen_by_filter(material, fault, len(paths), given.seed)
                    about = f"d' {d_prime:.1f}  "
                elif fault.kind == "missing":
                    seen = list(holes_seen(material, fault, len(paths), given.seed))
                elif fault.kind == "seam":
                    seen = [inspector.has_direction(material.name)] * len(paths)
                judged = zip(passes, seen, strict=True)
                rows[fault.name] += [_Judged(number, *each) for each in judged]
                print(
                    f"{material.name:24} {fault.name:24} {sum(passes):4} of {len(paths):4} pass  "
                    + about
                    + f"{sum(seen)} can be seen  " * (not all(seen))
                    + (f"{_counted(causes)}" if given.causes else ""),
                    flush=True,
                )
    met = [_row(fault, rows[fault.name]) for fault in faults]
    return int(not all(met))


def _counted(causes: Sequence[str]) -> str:
    return "; ".join(f"{causes.count(each)} {each}" for each in sorted(set(causes)))


def _row(fault: Fault, judged: Sequence[_Judged]) -> bool:
    """Print a line of the table; return whether the odd materials meet the target."""

    def counts(odd: int, *, seen: bool = False) -> tuple[int, int]:
        own = [each for each in judged if each.number % 2 == odd and each.seen >= seen]
        return sum(each.passes for each in own), len(own)

    shares = [counts(0), counts(1)]
    count, total = counts(int(shares[1][1] > 0), seen=True)
    met = True
    if fault is GOOD:
        met, wanted = total - count <= _MOST_REJECTED * total, "99 % or more"
    elif fault.most is None:
        wanted = "-"
    else:
        met, wanted = count <= fault.most * total, f"{fault.most:.0%} or less"
    even, odd = (f"{count:4} of {total:4}" for count, total in shares)
    seen = f"{count:4} of {total:4}"
    print(
        f"{fault.name:26} even {even}   odd {odd}   can be seen {seen}   "
        f"wanted {wanted}{'' if met else '   MISSED'}"
    )
    return met


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
