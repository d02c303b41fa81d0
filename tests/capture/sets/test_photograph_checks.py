"""Real photographs that import refuses, accepts, or accepts with a warning."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from capture import CapturedSet, SetRejected, import_images
from capture.sets.light_list import load_light_list
from classify import Lighting
from classify.base.errors import InputError
from classify.lights.algebra import require_solvable

DATA = Path(__file__).parents[2] / "data" / "butterfly_crop"
AMBIENT = DATA / "ambient.png"
PICKED = [DATA / f"image{number}.png" for number in (6, 0, 2, 4)]
LIGHTS = load_light_list(DATA / "lights.json")
Command = Callable[..., Any]
Refused = Callable[..., str]


def imported(paths: list[Path], lighting: Lighting | None = None, **options: Any) -> CapturedSet:
    lighting = lighting or LIGHTS.lighting_for(PICKED)
    return import_images(paths, lighting, ambient=AMBIENT, gamma="linear", **options)


def rejected(paths: list[Path], lighting: Lighting | None = None) -> str:
    with pytest.raises(SetRejected) as caught:
        imported(paths, lighting)
    message = str(caught.value)
    assert message.startswith("set rejected: ")
    return message.removeprefix("set rejected: ")


def changed(folder: Path, number: int, change: Callable[[np.ndarray], np.ndarray]) -> list[Path]:
    """The four photographs, one of them changed."""
    image = cv2.imread(str(PICKED[number]), cv2.IMREAD_GRAYSCALE)
    path = folder / PICKED[number].name
    cv2.imwrite(str(path), np.ascontiguousarray(change(image)))
    return [path if k == number else each for k, each in enumerate(PICKED)]


def test_true_photographs_are_confirmed_without_a_warning() -> None:
    metadata = imported(PICKED).metadata
    assert (metadata.warnings, metadata.accepted) == ((), ())
    assert metadata.checks is not None
    assert metadata.checks.light_order == "confirmed"
    assert metadata.checks.redundancy_residual is not None
    assert metadata.checks.redundancy_residual > 0.02  # a capture would be taken again


@pytest.mark.parametrize("order", [[2, 1, 0, 3], [0, 3, 2, 1], [1, 0, 2, 3], [1, 2, 3, 0]])
def test_photographs_in_another_order_than_their_lights_are_refused(order: list[int]) -> None:
    paths = [PICKED[k] for k in order]
    lighting = LIGHTS.lighting_for(PICKED)
    message = rejected(paths, lighting)
    tilts_deg = lighting.tilts_deg[order].round(1)
    found = [tilts_deg, tilts_deg[[order.index((k + 2) % 4) for k in order]]]
    named = [", ".join(f"{tilt:g}" for tilt in tilts) for tilts in found]
    assert any(f"were taken under tilts {tilts}, or all of" in message for tilts in named)
    assert message.endswith("(--accept light-order)")
    accepted = imported(paths, lighting, accept=["light-order"])
    assert accepted.metadata.accepted == ("light-order",)
    assert accepted.metadata.warnings[0].startswith("by their shading")


def test_exchanged_photographs_of_eight_are_named() -> None:
    paths = LIGHTS.image_paths()
    lighting = LIGHTS.lighting_for(paths)
    assert imported(paths, lighting).metadata.warnings == ()
    paths[3], paths[7] = paths[7], paths[3]
    message = "by its shading image7.png was taken under the light of image3.png and the other way"
    assert rejected(paths, lighting).startswith(message)
    downwards = Lighting(lighting.directions * (1.0, -1.0, 1.0))
    assert "with y pointing down" in rejected(LIGHTS.image_paths(), downwards)


def test_photographs_under_two_lights_that_are_given_one_direction_are_refused() -> None:
    paths = [DATA / f"image{number}.png" for number in (6, 0, 1, 3, 4)]
    message = rejected(paths, Lighting.from_angles([0.0, 90.0, 180.0, 270.0, 360.0], 12.0))
    assert "image6.png and image4.png have one light direction, tilt 0 degrees" in message
    repeated = [*PICKED, PICKED[0]]
    lighting = Lighting(LIGHTS.lighting_for(PICKED).directions[[0, 1, 2, 3, 0]])
    assert "one light direction" not in rejected(repeated, lighting)  # they are equal


def test_one_photograph_twice_is_refused() -> None:
    twice = [*PICKED[:3], PICKED[0]]
    assert "in 128 of 128 rows" in rejected(twice)
    metadata = imported(twice, accept=["equal-images", "light-order"]).metadata
    assert "equal-images" in metadata.accepted


def test_a_photograph_that_the_others_do_not_explain_is_refused(tmp_path: Path) -> None:
    message = rejected(changed(tmp_path, 1, np.rot90))
    assert "image0.png: the other" in message
    assert "(--accept residual)" in message


def test_spoilt_photographs_are_refused_and_lesser_faults_are_warnings(tmp_path: Path) -> None:
    bright = changed(tmp_path, 2, lambda image: cv2.convertScaleAbs(image, alpha=6.0))
    message = rejected(bright)
    assert "image2.png: up to " in message
    assert "at 255 (--accept saturation)" in message
    metadata = imported(bright, accept=["saturation", "residual", "light-order"]).metadata
    assert "saturation" in metadata.accepted
    glints = changed(
        tmp_path, 2, lambda image: np.where(image > np.quantile(image, 0.97), 255, image)
    )
    metadata = imported(glints).metadata
    assert metadata.accepted == ()
    (warning,) = metadata.warnings
    assert re.match(r"image2\.png: up to [23]\.\d% ", warning)
    dark = changed(tmp_path, 2, lambda _: cv2.imread(str(AMBIENT), cv2.IMREAD_GRAYSCALE))
    assert "image2.png: down to 0.0%" in rejected(dark)


def test_a_shifted_photograph_is_a_warning(tmp_path: Path) -> None:
    moved = changed(tmp_path, 2, lambda image: np.roll(image, 3, axis=1))
    warnings = imported(moved).metadata.warnings
    assert any(re.match(r"a photograph is shifted by about [234] px", text) for text in warnings)


def test_the_mosaic_of_a_colour_camera_is_a_warning(tmp_path: Path) -> None:
    filters = np.tile([[0.5, 1.0], [1.0, 0.7]], (64, 64))
    paths = [tmp_path / path.name for path in PICKED]
    for path, source in zip(paths, PICKED, strict=True):
        image = cv2.imread(str(source), cv2.IMREAD_GRAYSCALE)
        cv2.imwrite(str(path), (image * filters).astype(np.uint8))
    warnings = imported(paths).metadata.warnings
    assert any(re.match(r"neighbouring pixels differ by (49|5\d)%", text) for text in warnings)


def test_black_photographs_and_those_of_one_row_have_no_mosaic(tmp_path: Path) -> None:
    paths = [tmp_path / f"{number}.png" for number in range(4)]
    lighting = Lighting.ring(40.0)
    for value, shape in ((0, (40, 40)), (100, (1, 40))):
        for path in paths:
            cv2.imwrite(str(path), np.full(shape, value, np.uint8))
        accept = ["dark", "equal-images", "residual"]
        warnings = import_images(paths, lighting, gamma="linear", accept=accept).metadata.warnings
        assert not any("neighbouring pixels" in text for text in warnings)


def test_photographs_clipped_below_full_scale_are_a_warning(tmp_path: Path) -> None:
    clipped = changed(
        tmp_path, 2, lambda image: np.minimum(image, int(np.quantile(image, 0.97))).astype(np.uint8)
    )
    (warning,) = imported(clipped).metadata.warnings
    assert re.match(r"image2\.png: the light is clipped below full scale, at \d\d% of it", warning)


def test_a_spoilt_photograph_of_many_is_a_warning(tmp_path: Path) -> None:
    paths = LIGHTS.image_paths()
    paths[2] = changed(tmp_path, 2, lambda image: np.full_like(image, 255))[2]
    warnings = imported(paths, LIGHTS.lighting_for(paths)).metadata.warnings
    assert any("image2.png: up to 100.0%" in each for each in warnings)


def photographs_of_relief(
    folder: Path, lighting: Lighting, levels: np.ndarray, slope: float = 0.4
) -> list[Path]:
    """Photographs of a matt surface under lights of these levels."""
    x, y = np.meshgrid(np.arange(200), np.arange(200))
    p, q = slope * np.sin(0.2 * x + 0.05 * y), 0.75 * slope * np.cos(0.17 * y - 0.04 * x)
    normals = np.stack([-p, -q, np.ones_like(p)]) / np.sqrt(1 + p**2 + q**2)
    noise = np.random.default_rng(2).normal(0, 20, (len(lighting), 200, 200))
    shading = np.tensordot(lighting.directions, normals, 1)
    images = 40_000 * levels[:, None, None] * shading + noise
    paths = [folder / f"{k}.tif" for k in range(len(lighting))]
    for path, image in zip(paths, images, strict=True):
        cv2.imwrite(str(path), image.astype(np.uint16))
    return paths


def test_weak_lights_are_warnings(tmp_path: Path) -> None:
    """On a matt surface their redundancy tells, if it has relief."""
    ring = Lighting.ring(40.0)
    paths = photographs_of_relief(tmp_path, ring, np.array([1.0, 0.8, 1.0, 1.0]))
    metadata = import_images(paths, ring).metadata
    text = "1.tif: by the redundancy of the images its light gives 80% of the others"
    assert metadata.warnings == (text,)


@pytest.mark.parametrize("given", [(), (1.0, 0.8, 1.1, 0.9, 1.0, 0.6)])
def test_intensities_of_many_lights_that_the_images_contradict_are_a_warning(
    given: tuple[float, ...], tmp_path: Path
) -> None:
    levels = np.array([1.0, 0.5, 1.2, 0.9, 1.1, 0.7])
    lighting = Lighting.from_angles([0.0, 55.0, 120.0, 185.0, 240.0, 300.0], 40.0)
    paths = photographs_of_relief(tmp_path, lighting, levels)
    directions = lighting.directions
    (warning,) = import_images(paths, Lighting(directions, np.array(given))).metadata.warnings
    listed = re.fullmatch(r"by their redundancy .* intensities ([\d., ]+); --lights .*", warning)
    assert listed is not None
    fitted = np.array([*map(float, listed[1].split(", "))])
    np.testing.assert_allclose(fitted / fitted[0], levels / levels[0], rtol=0.01)
    assert import_images(paths, Lighting(directions, fitted)).metadata.warnings == ()


def test_intensities_of_many_lights_on_a_flat_part_are_unknown(tmp_path: Path) -> None:
    lighting = Lighting.from_angles([0.0, 55.0, 120.0, 185.0, 240.0, 300.0], 40.0)
    paths = photographs_of_relief(tmp_path, lighting, np.linspace(0.6, 1.0, 6), slope=0.0)
    assert import_images(paths, lighting).metadata.warnings == ()


# lights


@pytest.mark.parametrize(
    ("tilts", "slants", "message"),
    [
        ([30.0] * 4, 45.0, "different directions: 1 of 4;"),
        ([0.0, 180.0, 0.0, 180.0], 45.0, "different directions: 2 of 4;"),
        ([0.0, 90.0], 45.0, "different directions: 2 of 2;"),
        ([0.0], 45.0, "different directions: 1 of 1;"),
        ([0.0, 0.0, 180.0, 180.0], [20.0, 50.0, 20.0, 50.0], "in one plane"),
        ([0.0, 90.0, 180.0, 270.0], 0.0, "different directions: 1 of 4;"),
    ],
)
def test_lights_that_cannot_be_solved_from_are_refused(
    tilts: list[float], slants: Any, message: str
) -> None:
    lighting = Lighting.from_angles(tilts, slants)
    with pytest.raises(InputError, match=message):
        require_solvable(lighting)
    with pytest.raises(InputError, match=message):
        import_images(PICKED[: len(tilts)], lighting)


def test_four_lights_that_only_least_squares_can_solve_are_a_warning() -> None:
    lighting = Lighting.from_angles([0.0, 0.0, 0.0, 90.0], [10.0, 30.0, 50.0, 40.0])
    metadata = import_images(PICKED, lighting, accept=["light-order"]).metadata
    assert any("solve with --method least_squares" in warning for warning in metadata.warnings)


# the command


def test_the_command_names_the_cause_and_its_option(
    ps4rig: Command, refused: Refused, tmp_path: Path
) -> None:
    out = tmp_path / "a.ome.tif"
    arguments = ("import", *PICKED[::-1], out, "--tilts", "352,88,190,270", "--slant", 12)
    arguments += ("--ambient", AMBIENT, "--gamma", "linear")
    line = refused(*arguments, status=1)
    assert line.endswith("(--accept light-order)")
    assert not out.exists()
    result = ps4rig(*arguments, "--accept", "light-order", "--json")
    (warning,) = json.loads(result.stdout)["warnings"]
    assert result.stderr == f"ps4rig: warning: {out}: {warning}\n"
    assert CapturedSet.load(out).metadata.warnings == (warning,)
    assert ps4rig("solve", out, "--out", tmp_path / "maps").exit_code == 0
    assert warning in (tmp_path / "maps" / "index.html").read_text()


def test_unknown_keys_of_lights_are_warnings_of_the_set(
    ps4rig: Command, refused: Refused, tmp_path: Path
) -> None:
    entries = json.loads((DATA / "lights.json").read_text())["images"]
    lights = tmp_path / "lights.json"
    lights.write_text(json.dumps([entry | {"relative_intensity": 1} for entry in entries]))
    out = tmp_path / "a.ome.tif"
    arguments = ("import", *PICKED, out, "--ambient", AMBIENT, "--lights", lights)
    arguments = (*arguments, "--gamma", "linear")
    assert '"relative_intensity"' in refused(*arguments)
    result = ps4rig(*arguments, "--accept", "light-keys", "--json")
    expected = "lights.json: unknown keys are ignored: relative_intensity"
    assert json.loads(result.stdout)["warnings"] == [expected]
    assert not CapturedSet.load(out).lighting.intensities_given
