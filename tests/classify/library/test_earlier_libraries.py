"""Libraries that earlier versions wrote are read and give the same matches."""

from pathlib import Path

import pytest

from classify import TextureLibrary

LIBRARIES = Path(__file__).parents[2] / "data" / "libraries"
# (label, nearest, orientation_deg, distance, limit) of two surfaces, by the program that trained.
EXPECTED = {
    "joint": [
        ("grün", "grün", 59.524338, 0.18064800, 4.40851264),
        (None, "fine", 15.918883, 24.93822605, 3.93723355),
    ],
    "polar_radial": [
        ("grün", "grün", 59.390738, 0.00390121, None),
        ("fine", "fine", 108.484956, 0.21704647, None),
    ],
    "varma_zisserman": [
        ("grün", "grün", None, 0.29499635, None),
        ("fine", "fine", None, 0.44152337, None),
    ],
}


@pytest.mark.parametrize("classifier", EXPECTED)
def test_a_library_of_an_earlier_version_gives_the_same_matches(
    classifier: str, stationary, photographed
) -> None:
    library = TextureLibrary.load(LIBRARIES / f"{classifier}.ps4lib")
    assert library.classifier == classifier
    assert library.classes == ("grün", "fine")
    assert library.simulated
    assert not library.planar
    assert library.sources == (("one.ome.tif", "ab" * 32),)
    for kind, expected in zip(("sand", "malv"), EXPECTED[classifier], strict=True):
        match = library.classify(photographed(stationary(kind, 60.0, seed=3, side=80)))
        assert (match.label, match.nearest) == expected[:2]
        assert match.blur_px is None
        for found, number in zip(
            (match.orientation_deg, match.distance, match.limit), expected[2:], strict=True
        ):
            assert found == (None if number is None else pytest.approx(number, rel=1e-3))


# (label, orientation_deg, distance, limit) by libraries of file versions 4 and 5.
EXPECTED_BLURRED = {
    "joint_4": [
        ("grün", 61.028467, 0.19309199, 1.67114353),
        ("fine", 66.167507, 0.22035628, 1.380019),
    ],
    "joint_5": [
        ("grün", 61.025413, 0.21845838, 1.83828652),
        ("fine", 93.704481, 0.14920596, 1.44002903),
    ],
}


@pytest.mark.parametrize("name", EXPECTED_BLURRED)
def test_a_library_keeps_the_weights_of_its_version(name: str, stationary, photographed) -> None:
    library = TextureLibrary.load(LIBRARIES / f"{name}.ps4lib")
    expected = EXPECTED_BLURRED[name]
    for kind, numbers in zip(("sand", "malv"), expected, strict=True):
        match = library.classify(photographed(stationary(kind, 60.0, seed=3, side=80)))
        found = (match.orientation_deg, match.distance, match.limit)
        assert match.label == numbers[0]
        assert found == pytest.approx(numbers[1:], rel=1e-3)
