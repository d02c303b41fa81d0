"""Look-alikes: distances in units of what good windows of that place differ by."""

import numpy as np

from classify.pieces.look_alikes import LookAlikes

COLUMNS = (0, 2)
TIGHT, LOOSE = 0.1, 1.0


def places(seed: int, count: int = 200) -> np.ndarray:
    """Windows of a part: half of them bricks, which hardly differ, half of them joints."""
    draw = np.random.default_rng(seed)
    joint = np.arange(count) % 2
    spread = np.where(joint, LOOSE, TIGHT)[:, None]
    middle = np.where(joint, 20.0, 0.0)[:, None]
    return (middle + spread * draw.normal(size=(count, 3))).astype(np.float32)


def learned() -> tuple[LookAlikes, list[np.ndarray]]:
    return LookAlikes.of([places(seed) for seed in range(6)], COLUMNS)


def test_a_joint_does_not_excuse_a_fault_on_a_brick() -> None:
    model, scores = learned()
    highest = max(float(each.max()) for each in scores)
    offset = np.full(3, 1.5, np.float32)
    brick, joint = offset, 20.0 + offset
    on_brick, on_joint = model.scores(np.stack([brick, joint]))
    assert on_brick > highest > on_joint


def test_parts_that_are_left_out_are_as_far_as_new_ones() -> None:
    model, scores = learned()
    new = np.concatenate([model.scores(places(seed)) for seed in range(100, 106)])
    assert 0.7 < np.median(new) / np.median(np.concatenate(scores)) < 1.4


def test_features_that_are_not_compared_change_nothing() -> None:
    model, _ = learned()
    windows = places(50)
    changed = windows.copy()
    changed[:, 1] += 100.0
    np.testing.assert_allclose(model.scores(windows), model.scores(changed), rtol=1e-4)


def test_three_parts_are_enough() -> None:
    _, scores = LookAlikes.of([places(seed, 40) for seed in range(3)], COLUMNS)
    assert all(np.isfinite(each).all() for each in scores)
