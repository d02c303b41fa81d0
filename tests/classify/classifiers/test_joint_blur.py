"""The default classifier out of focus: recognition, blur found, and bounds."""

from dataclasses import replace

import numpy as np
import pytest

from classify import TextureLibrary
from classify.texture.blur import blurred_surface
from tests.angles import off_deg

KINDS = ("sand", "fine sand", "brushed", "malv", "rough", "dyed", "domes", "pits")
# Sand has waves of one length and little else: its blur is a factor like that of its slopes.
FINE = ("brushed", "malv", "rough", "dyed")


@pytest.fixture(scope="module")
def library(stationary) -> TextureLibrary:
    return TextureLibrary.train((kind, stationary(kind, seed=1)) for kind in KINDS)


@pytest.fixture(scope="module")
def tests(stationary):
    return {kind: stationary(kind, 58.0, seed=3) for kind in KINDS}


@pytest.mark.parametrize("sigma_px", [0.6, 1.0])
def test_a_surface_out_of_focus_is_recognised_and_its_blur_found(
    library, tests, sigma_px: float
) -> None:
    for kind, surface in tests.items():
        match = library.classify(blurred_surface(surface, sigma_px))
        assert match.label == kind, match.reason
        sharp = library.classify(surface)
        if kind in FINE:
            assert match.blur_px == pytest.approx(sigma_px, abs=0.3)
            assert f"{match.blur_px:.1f} px blurrier" in match.reason
            assert abs(sharp.blur_px) < 0.5
        if kind in ("sand", "fine sand", "brushed"):
            assert off_deg(match.orientation_deg, sharp.orientation_deg) < 1.0


@pytest.mark.parametrize("sigma_px", [0.8, 1.1])
def test_a_surface_sharper_than_its_training_set_is_recognised(
    stationary, tests, sigma_px: float
) -> None:
    library = TextureLibrary.train(
        (kind, blurred_surface(stationary(kind, seed=1), sigma_px)) for kind in KINDS
    )
    for kind, surface in tests.items():
        match = library.classify(surface)
        assert match.label == kind, match.reason
        if kind in FINE:
            assert match.blur_px == pytest.approx(-sigma_px, abs=0.3)
            assert f"{-match.blur_px:.1f} px sharper" in match.reason


def test_a_surface_far_out_of_focus_is_unknown_and_the_reason_says_so(library, tests) -> None:
    for kind in FINE:
        match = library.classify(blurred_surface(tests[kind], 3.5))
        assert match.label is None
        assert "out of focus" in match.reason


def test_blur_is_not_added_to_decide_between_two_classes(stationary, tests) -> None:
    """Two patches of one texture under two labels, both blurrier than the test."""
    patches = [("a", stationary("malv", seed=1)), ("b", stationary("malv", seed=2))]
    alike = TextureLibrary.train((label, blurred_surface(each, 0.9)) for label, each in patches)
    match = alike.classify(tests["malv"])
    assert match.blur_px < -0.5
    assert match == alike.match(alike.observe(tests["malv"]))
    assert match.label is None


def test_the_nearest_of_many_is_found_out_of_focus(library, tests) -> None:
    """Bounds follow the changes by blur, so that few references are compared."""
    rng = np.random.default_rng(0)
    count = 600
    members = np.arange(count) % len(KINDS)
    signatures = library.signatures[members]
    # Classes between the textures: near each other, and far from most.
    shares = 0.3 * rng.random((count, 1), dtype=np.float32)
    signatures[:, :-1] += shares * (
        library.signatures[(members + 3) % len(KINDS), :-1] - signatures[:, :-1]
    )
    everything = replace(
        library,
        labels=tuple(f"class {index}" for index in range(count)),
        orientations_deg=np.zeros(count),
        signatures=signatures,
        limits={},
    )
    large = replace(everything, compare_all_up_to=100)
    for kind in FINE:
        signature = large.observe(blurred_surface(tests[kind], 1.0))
        expected, found = everything.match(signature), large.match(signature)
        assert (found.nearest, found.runner_up) == (expected.nearest, expected.runner_up)
        assert found.distance == pytest.approx(expected.distance, rel=1e-5)
        assert len(large.candidates(signature)[0]) < 300
