"""Table of the tuned numbers of the joint classifier, each halved and doubled.

    pytest -m slow -s tests/classify/classifiers/test_joint_constants.py

The textures are the bundled materials and synthetic ones, one training set a class. Each row has
the percent of the other patches whose nearest class is right; the 99th percentile of distance over
limit of known patches, beyond 1 where more than 1 % are refused; and the 5th percentile of patches
whose class is left out, below 1 where more than 5 % are accepted.
"""

from collections.abc import Sequence

import numpy as np
import pytest

from capture.chapter.patches import CachedPatch
from capture.chapter.plan import Conditions, PatchPosition, Texture, material_textures
from classify.classifiers import CLASSIFIERS, joint, joint_features, joint_learning, joint_limits
from rig import SYNTHETIC_30

JOINT = CLASSIFIERS["joint"]
ORIENTATIONS_DEG = (23.0, 101.0)
SIZES_PX = (256, 128)

CONSTANTS = {
    joint_features: ("_CAP_BINS", "_ALBEDO_LEAK", "_CHANNEL_WEIGHTS"),
    joint_learning: ("_SPECTRAL_SHARE", "_FLOOR_ERRORS", "_FLOOR_QUANTILE", "_TYPICAL_DEGREES",
                     "_TYPICAL_SETS", "_TYPICAL_SPECTRAL", "_CONTRAST_VARIANCE"),
    joint_limits: ("_SCATTER_POWER", "_LEAST_SCATTER", "_LARGEST_FACTOR", "_MEDIAN",
                   "_CLASS_SPREAD", "_PATCH_SPREAD"),
    joint: ("_LEAST_NEW",),
}  # fmt: skip


def _textures() -> list[Texture]:
    return [*material_textures(), *(Texture(name) for name in SYNTHETIC_30[::2])]


@pytest.fixture(scope="module", params=SIZES_PX)
def observed(request):
    """(training observations, [(label, observation of another patch)], side)."""
    conditions = Conditions(45.0, request.param)
    trained, tested = {}, []
    for texture in _textures():
        position = PatchPosition(texture, 0, (0.0, 0.0), 0.0)
        surface = CachedPatch(position, request.param).surface(conditions, "ps4_robust")
        trained[texture.name] = JOINT.observe_training(surface, request.param // 2)
        for number, rotate_deg in enumerate(ORIENTATIONS_DEG):
            position = PatchPosition(texture, 1000 + number, (0.5, 0.5), rotate_deg)
            surface = CachedPatch(position, request.param).surface(conditions, "ps4_robust")
            tested.append((texture.name, JOINT.observe(surface, request.param // 2)))
    return trained, tested, request.param


def _rates(trained, tested) -> tuple[float, float, float]:
    """Nearest right in %, and quantiles of known and unknown distances over limits."""
    labels = list(trained)
    parameters = JOINT.learn(list(trained.values()), labels)
    rows = [JOINT.references(each, parameters) for each in trained.values()]
    numbers = np.repeat(np.arange(len(rows)), [len(row) for row in rows])
    references = np.concatenate(rows)

    def limits(kept: Sequence[int]) -> dict[int, float]:
        found = JOINT.limits(
            [labels[number] for number in numbers[kept]], numbers[kept].tolist(),
            references[kept], parameters,
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


@pytest.mark.slow
def test_halved_and_doubled_constants(observed, monkeypatch) -> None:
    trained, tested, side_px = observed
    print(f"\n{side_px} px, {len(trained)} classes | right, % | known, 99 % | unknown, 5 %")
    shipped = _rates(trained, tested)
    print("shipped | {:.1f} | {:.2f} | {:.2f}".format(*shipped))
    assert shipped[0] > 95.0
    for module, names in CONSTANTS.items():
        for name in names:
            value = getattr(module, name)
            for factor in (0.5, 2.0):
                changed = (1.0, factor, 4.0) if name == "_CHANNEL_WEIGHTS" else factor * value
                if name == "_FLOOR_QUANTILE":
                    changed = 0.5 if factor < 1.0 else 1.0
                elif name == "_SPECTRAL_SHARE":
                    changed = 1.0 / 3.0 if factor < 1.0 else 2.0 / 3.0
                with monkeypatch.context() as patch:
                    patch.setattr(module, name, changed)
                    rates = _rates(trained, tested)
                print("{} {:} | {:.1f} | {:.2f} | {:.2f}".format(name, changed, *rates), flush=True)
