"""Table of the tuned numbers of the joint classifier, each halved and doubled.

    python -m tests.evidence.joint_constants [--quick]

The textures are the bundled materials and synthetic ones, one training set a class. Each row has
the percent of the other patches whose nearest class is right; the 99th percentile of distance over
limit of known patches, beyond 1 where more than 1 % are refused; and the 5th percentile of patches
whose class is left out, below 1 where more than 5 % are accepted. --quick has the row of the
shipped numbers alone, at 128 px.
"""

import argparse
import sys
from collections.abc import Sequence

import numpy as np

from capture.chapter.plan import Conditions, PatchPosition, Texture, material_textures
from capture.chapter.runs import CachedPatch
from classify.classifiers import classifier_named, joint, joint_features, joint_learning
from classify.texture.uniformity import uniformity_of
from rig import SYNTHETIC_30

from .limits import at_least

JOINT = classifier_named("joint")
ORIENTATIONS_DEG = (23.0, 101.0)
SIZES_PX = (256, 128)
ROW = "{:.1f} | {:.2f} | {:.2f}"

CONSTANTS = {
    joint_features: ("_ALBEDO_LEAK", "_CHANNEL_WEIGHTS"),
    joint_learning: ("_CAP_BINS", "_SPECTRAL_SHARE", "_FLOOR_ERRORS", "_FLOOR_QUANTILE",
                     "_TYPICAL_FREEDOM", "_TYPICAL_SETS", "_TYPICAL_SPECTRAL", "_CONTRAST_VARIANCE",
                     "_SCATTER_POWER", "_MIN_SCATTER", "_MAX_FACTOR", "_MEDIAN_DISTANCE",
                     "_CLASS_SPREAD", "_PATCH_SPREAD"),
    joint: ("_MIN_SQUARED_DISTANCE",),
}  # fmt: skip


def _textures() -> list[Texture]:
    return [*material_textures(), *(Texture(name) for name in SYNTHETIC_30[::2])]


def _observed(side_px: int):
    """(training observations, [(label, observation of another patch)])."""
    conditions = Conditions(45.0, side_px)
    trained, tested = {}, []
    for texture in _textures():
        position = PatchPosition(texture, 0, (0.0, 0.0), 0.0)
        surface = CachedPatch(position, side_px).surface(conditions, "ps4_robust")
        trained[texture.name] = JOINT.observe_training(surface, side_px // 2)
        for number, rotate_deg in enumerate(ORIENTATIONS_DEG):
            position = PatchPosition(texture, 1000 + number, (0.5, 0.5), rotate_deg)
            surface = CachedPatch(position, side_px).surface(conditions, "ps4_robust")
            tested.append((texture.name, JOINT.observe(surface, side_px // 2)))
    return trained, tested


def _rates(trained, tested) -> tuple[float, float, float]:
    """Nearest right in %, and quantiles of known and unknown distances over limits."""
    labels = list(trained)
    parameters = JOINT.learn(list(trained.values()), labels)
    rows = [JOINT.references(each, parameters) for each in trained.values()]
    numbers = np.repeat(np.arange(len(rows)), [len(row) for row in rows])
    references = np.concatenate(rows)
    uniformity = {label: uniformity_of([each.unevenness]) for label, each in trained.items()}

    def limits(kept: Sequence[int]) -> dict[int, float]:
        found = JOINT.limits(
            [labels[number] for number in numbers[kept]], numbers[kept].tolist(),
            references[kept], parameters, uniformity,
        )  # fmt: skip
        return {labels.index(label): limit for label, limit in found.items()}

    everything = limits(np.arange(len(numbers)))
    right, known, unknown = 0, [], []
    without = {}
    for label, observation in tested:
        own = labels.index(label)
        distances = JOINT.compare(
            JOINT.signature(observation, parameters), references, parameters
        ).distances
        nearest = int(numbers[distances.argmin()])
        right += nearest == own
        known.append(distances.min() / everything[nearest])
        others = np.flatnonzero(numbers != own)
        if own not in without:
            without[own] = limits(others)
        other = int(numbers[others[distances[others].argmin()]])
        unknown.append(distances[others].min() / without[own][other])
    return (
        100.0 * right / len(tested),
        float(np.quantile(known, 0.99)),
        float(np.quantile(unknown, 0.05)),
    )


def _changes(name: str, value: float | tuple[float, ...]) -> tuple[object, object]:
    """The two other values that a constant is given."""
    if name == "_CHANNEL_WEIGHTS":
        return (1.0, 0.5, 4.0), (1.0, 2.0, 4.0)
    if name == "_FLOOR_QUANTILE":
        return 0.5, 1.0
    if name == "_SPECTRAL_SHARE":
        return 1.0 / 3.0, 2.0 / 3.0
    return 0.5 * value, 2.0 * value


def _print_changes(trained, tested) -> None:
    for module, names in CONSTANTS.items():
        for name in names:
            shipped = getattr(module, name)
            for changed in _changes(name, shipped):
                setattr(module, name, changed)
                print(f"{name} {changed} |", ROW.format(*_rates(trained, tested)), flush=True)
            setattr(module, name, shipped)


def main(arguments: Sequence[str]) -> int:
    """Print the tables; return 1 if the shipped numbers recognise too few patches."""
    parser = argparse.ArgumentParser(prog="joint_constants")
    parser.add_argument("--quick", action="store_true", help="shipped numbers, 128 px")
    given = parser.parse_args(arguments)
    are_met = []
    for side_px in (128,) if given.quick else SIZES_PX:
        trained, tested = _observed(side_px)
        print(f"\n{side_px} px, {len(trained)} classes | right, % | known, 99 % | unknown, 5 %")
        shipped = _rates(trained, tested)
        print("shipped |", ROW.format(*shipped))
        are_met.append(at_least(f"right at {side_px} px, %", shipped[0], 95.0))
        if not given.quick:
            _print_changes(trained, tested)
    return int(not all(are_met))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
