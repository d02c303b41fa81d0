"""Light directions from `.lp` and `.json` files."""

import json
import unicodedata
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from capture.sets.light_list import LightList, load_light_list, write_light_list
from classify import Lighting
from classify.base.errors import InputError

Form = Literal["NFC", "NFD"]
RING = Lighting.ring(30.0)
NAMES = ("a.png", "b.png", "c.png", "d.png")
VECTORS = RING.directions.tolist()
PATHS = [Path("photos") / name for name in NAMES]


def written(folder: Path, content: Any, name: str = "lights.lp") -> Path:
    """Write text or bytes as they are, anything else as JSON."""
    path = folder / name
    if not isinstance(content, bytes):
        content = (content if isinstance(content, str) else json.dumps(content)).encode()
    path.write_bytes(content)
    return path


def as_json(folder: Path, content: Any) -> Path:
    return written(folder, content, "lights.json")


def rows(names: tuple[str, ...] = NAMES) -> list[str]:
    return [
        f"{name} {x:.17g} {y:.17g} {z:.17g}"
        for name, (x, y, z) in zip(names, RING.directions, strict=True)
    ]


def with_files(*paths: Path) -> list[Path]:
    for path in paths:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    return list(paths)


@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf"])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\n\n", "  \n"])
def test_an_lp_file_gives_the_lights_of_its_images_in_any_order(
    tmp_path: Path, end: str, mark: bytes
) -> None:
    content = mark + (end.join(["4", *rows()]) + end).encode()
    lights = load_light_list(written(tmp_path, content))
    assert lights.image_paths() == [tmp_path / name for name in NAMES]
    assert lights.lighting_for(PATHS) == RING
    backwards = lights.lighting_for(PATHS[::-1])
    np.testing.assert_array_equal(backwards.directions, RING.directions[::-1])
    assert len(lights.lighting_for(PATHS[1:3])) == 2


@pytest.mark.parametrize(
    "folder", ["", "C:\\Users\\me\\my photos\\", "/home/me/", "..\\", "\\\\server\\share\\", "x/y/"]
)
def test_names_may_contain_blanks_and_folders_of_another_computer(
    tmp_path: Path, folder: str
) -> None:
    names = tuple(f"my  photo {name}" for name in NAMES)
    lines = rows(tuple(folder + name for name in names))
    lights = load_light_list(written(tmp_path, "\r\n".join(["4", *lines])))
    with_files(*(tmp_path / name for name in names))
    assert lights.image_paths() == [tmp_path / name for name in names]
    assert lights.lighting_for([Path("elsewhere") / name for name in names]) == RING


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "line 1 must be"),
        ("\na.png 0 0 1\n", "line 2 .*not 'a.png 0 0 1'"),
        ("2\na.png 0 0 1\n", "announces 2 lights and lists 1"),
        ("1\na.png 0 0 1\nb.png 0 0 1\n", "announces 1 lights and lists 2"),
        ("9" * 5000 + "\na.png 0 0 1\n", "announces 999999999 lights and lists 1"),
        ("0\n", "lists 0 lights; 1 to 255"),
        ("2\na.png 0 0 1\n\nb.png 0 0 up\n", "line 4 is not"),
        ("1\na.png 0_5 0 1\n", "line 2 .*: 'a.png 0_5 0 1'"),
        ("1\na.png 0,5 0,5 0,7\n", "line 2 .*: 'a.png 0,5 0,5 0,7'"),
        ("1\na.png \u0660 0 1\n", "line 2 is not"),
        (b"2\na.png 0 0 1\n\xff.png 0 0 1\n", "line 3 is not UTF-8"),
        ("1\na\0b.png 0 0\n", "line 2 is not"),
        ("1\na.png 0 0 1 0.9 1 0.8\n", "line 2 is not 'name x y z' or 'name x y z intensity'"),
    ],
)
def test_an_error_in_an_lp_file_names_file_and_line(
    tmp_path: Path, content: str | bytes, message: str
) -> None:
    with pytest.raises(InputError, match=rf"lights\.lp: {message}"):
        load_light_list(written(tmp_path, content))


@pytest.mark.parametrize(
    ("vector", "message"),
    [
        ("0 1 0", r"horizon .*\[0\.0, 1\.0, 0\.0\]"),
        ("0.75 0 -0.0002", r"horizon .*\[0\.75, 0\.0, -0\.0002\]"),
        ("nan 0 1", "not finite"),
        ("0 0 0", "zero"),
        ("0 0 1 -2", "intensity -2"),
    ],
)
def test_an_impossible_light_names_file_line_and_value(
    tmp_path: Path, vector: str, message: str
) -> None:
    more = " 1" if len(vector.split()) == 4 else ""
    lights = load_light_list(written(tmp_path, f"2\nb.png 0 0 1{more}\na.png {vector}\n"))
    with pytest.raises(InputError, match=rf"lights\.lp: line 3, a\.png.*{message}"):
        lights.lighting_for([Path("a.png")])
    assert len(lights.lighting_for([Path("b.png")])) == 1


def test_an_impossible_light_in_json_names_its_image(tmp_path: Path) -> None:
    entries = [{"file": "a.png", "direction": [0, 0, 1]}, {"file": "b.png", "direction": [1, 0, 0]}]
    lights = load_light_list(as_json(tmp_path, entries))
    with pytest.raises(InputError, match=r"lights\.json: image 1, b\.png"):
        lights.lighting_for(lights.image_paths())
    lights = load_light_list(as_json(tmp_path, [[0, 0, 1], [1, 0, -0.25]]))
    with pytest.raises(InputError, match=r"lights\.json: image 1: .*\[1\.0, 0\.0, -0\.25\]"):
        lights.lighting_for(PATHS[:2])


# text


@pytest.mark.parametrize("coding", ["utf-16", "utf-16-be-with-mark", "utf-8-sig"])
@pytest.mark.parametrize("name", ["lights.lp", "lights.json"])
def test_text_of_any_marked_coding_is_read(tmp_path: Path, coding: str, name: str) -> None:
    names = tuple(f"b\u00fcrste {name}" for name in NAMES)
    entries = [{"file": n, "direction": v} for n, v in zip(names, VECTORS, strict=True)]
    text = json.dumps(entries) if name.endswith("json") else "\r\n".join(["4", *rows(names)])
    mark = "\ufeff" if coding.endswith("mark") else ""
    content = (mark + text).encode(coding.removesuffix("-with-mark"))
    lights = load_light_list(written(tmp_path, content, name))
    assert lights.lighting_for([tmp_path / name for name in names]) == RING


@pytest.mark.parametrize("quote", ['"', "'"])
def test_a_name_in_quotes_is_read_without_them(tmp_path: Path, quote: str) -> None:
    lines = [f"{quote}my photo {k}.JPG{quote} 0.5 {k} 1 {level}" for k, level in ((1, 2), (2, 1))]
    lights = load_light_list(written(tmp_path, "\n".join(["2", *lines])))
    assert lights.names == ["my photo 1.JPG", "my photo 2.JPG"]
    assert lights.lighting_for([Path("my photo 2.JPG")]).intensities.tolist() == [1.0]


# places of the photographs


def listed(folder: Path, *names: str) -> LightList:
    """Return a list in `folder` that names the photographs, with light k at height k + 1."""
    folder.mkdir(exist_ok=True)
    lines = [f"{name} 1 0 {k + 1}" for k, name in enumerate(names)]
    return load_light_list(written(folder, "\n".join([str(len(names)), *lines])))


def heights(lighting: Lighting) -> list[int]:
    return [round(z / x) - 1 for x, _, z in lighting.directions]


@pytest.mark.parametrize("folder", ["../captures/", "..\\captures\\", ".\\..\\captures/", "/"])
def test_the_folder_that_a_list_names_is_used(tmp_path: Path, folder: str) -> None:
    files = with_files(*(tmp_path / "captures" / f"{k}.jpg" for k in (1, 2)))
    folder = f"{tmp_path}/captures/" if folder == "/" else folder
    lights = listed(tmp_path / "lists", f"{folder}1.jpg", f"{folder}2.jpg")
    assert all(map(Path.samefile, lights.image_paths(), files))


def test_a_namesake_beside_the_list_is_refused_unless_it_is_the_same_file(tmp_path: Path) -> None:
    named_file, namesake = tmp_path / "captures" / "1.jpg", tmp_path / "lists" / "1.jpg"
    with_files(named_file, namesake)
    lights = listed(tmp_path / "lists", "../captures/1.jpg")
    with pytest.raises(InputError, match=r"lights\.lp: \.\./captures/1\.jpg may be"):
        lights.image_paths()
    assert heights(lights.lighting_for([namesake])) == [0]
    namesake.unlink()
    namesake.symlink_to(named_file)
    assert lights.image_paths()[0].samefile(named_file)


def test_photographs_are_not_taken_from_two_places(tmp_path: Path) -> None:
    with_files(tmp_path / "captures" / "1.jpg", tmp_path / "lists" / "2.jpg")
    lights = listed(tmp_path / "lists", "../captures/1.jpg", "../captures/2.jpg")
    assert [path.exists() for path in lights.image_paths()] == [True, False]


FORMS: tuple[Form, ...] = ("NFC", "NFD")


@pytest.mark.parametrize("folder", ["", "gr\u00fcn/"])
@pytest.mark.parametrize("on_disk", FORMS)
@pytest.mark.parametrize("in_list", FORMS)
def test_a_name_is_found_in_another_unicode_form(
    tmp_path: Path, in_list: Form, on_disk: Form, folder: str
) -> None:
    name = f"{folder}b\u00fcrste.png"
    [file] = with_files(tmp_path / unicodedata.normalize(on_disk, name))
    lights = listed(tmp_path, unicodedata.normalize(in_list, name), "a.png")
    assert lights.image_paths() == [file, tmp_path / "a.png"]
    assert heights(lights.lighting_for([Path("a.png"), file])) == [1, 0]


@pytest.mark.parametrize("in_list", FORMS)
def test_files_that_differ_in_their_form_only_are_refused(tmp_path: Path, in_list: Form) -> None:
    with_files(*(tmp_path / unicodedata.normalize(form, "\u00e9.png") for form in FORMS))
    lights = listed(tmp_path, unicodedata.normalize(in_list, "\u00e9.png"))
    with pytest.raises(InputError, match=r"\.png may be .* or "):
        lights.image_paths()


@pytest.mark.parametrize("name", ["a.png", "./a.png", "C:\\a.png", "x/../a.png"])
def test_a_photograph_that_is_listed_twice_is_refused(tmp_path: Path, name: str) -> None:
    with_files(tmp_path / "x" / "b.png", tmp_path / "a.png")
    lights = listed(tmp_path, "a.png", name)
    with pytest.raises(InputError, match=r"lights\.lp: .*a\.png twice"):
        lights.image_paths()
    with pytest.raises(InputError, match=r"a\.png may be .* line 2 or line 3"):
        lights.lighting_for([Path("a.png")])


def test_images_of_one_name_in_two_folders_get_their_own_lights(tmp_path: Path) -> None:
    lights = listed(tmp_path, "left/1.jpg", "D:\\day\\right\\1.jpg", "1.jpg")
    images = [tmp_path / "1.jpg", Path("moved/right/1.jpg"), tmp_path / "left" / "1.jpg"]
    assert heights(lights.lighting_for(images)) == [2, 1, 0]
    with pytest.raises(InputError, match=r"other/1\.jpg may be .*2 or line 3 or line 4"):
        lights.lighting_for([Path("other/1.jpg")])


def test_two_images_do_not_get_one_light(tmp_path: Path) -> None:
    lights = listed(tmp_path, "1.jpg", "2.jpg")
    with pytest.raises(InputError, match=r"left/1\.jpg and right/1\.jpg .*line 2"):
        lights.lighting_for([Path("left/1.jpg"), Path("right/1.jpg")])


def test_an_image_that_is_not_listed_is_named(tmp_path: Path) -> None:
    lights = load_light_list(written(tmp_path, "\n".join(["4", *rows()])))
    with pytest.raises(InputError, match=r"no light for e\.png"):
        lights.lighting_for([*PATHS[:3], Path("e.png")])
    with pytest.raises(InputError, match=rf"for .*\.PNG, but for {PATHS[3].name}; rename one"):
        lights.lighting_for([*PATHS[:3], PATHS[3].with_suffix(".PNG")])


# json


def test_json_may_list_vectors_in_the_order_of_the_images(tmp_path: Path) -> None:
    lights = load_light_list(as_json(tmp_path, RING.directions.tolist()))
    assert lights.lighting_for([Path(f"{n}.png") for n in range(4)]) == RING
    with pytest.raises(InputError, match=r"4 lights for 3 images"):
        lights.lighting_for(PATHS[:3])
    assert lights.image_paths() == []


@pytest.mark.parametrize("wrapped", [False, True])
def test_json_may_name_its_images(tmp_path: Path, wrapped: bool) -> None:
    entries = [
        {"file": f"D:\\x\\{name}", "direction": vector, "tilt_deg": 1}
        for name, vector in zip(NAMES, RING.directions.tolist(), strict=True)
    ]
    content = {"name": "ring", "images": entries} if wrapped else entries
    lights = load_light_list(as_json(tmp_path, content))
    files = with_files(*(tmp_path / name for name in NAMES))
    assert lights.image_paths() == files
    np.testing.assert_array_equal(
        lights.lighting_for(PATHS[::-1]).directions, RING.directions[::-1]
    )


def test_an_error_in_json_names_the_entry_and_its_value(tmp_path: Path) -> None:
    first = {"file": "a.png", "direction": [0, 0, 1]}
    content = {"images": [first, first | {"file": "b.png", "intensity": -1}]}
    with pytest.raises(InputError, match=r"images\.1\.intensity: .*, not -1$"):
        load_light_list(as_json(tmp_path, content))


@pytest.mark.parametrize("content", [
    {}, "null", [[0, 0]], [[True, 0, 1]], "[[0, 0, NaN]]", "[" + "1" * 5000 + "]", "[" * 100_000,
    [{"file": "a.png"}], [{"direction": [0, 0, 1]}, [0, 0, 1]],
])  # fmt: skip
def test_an_error_in_json_shows_the_right_form(tmp_path: Path, content: Any) -> None:
    with pytest.raises(InputError, match=r"lights\.json: .*give \[\[x, y, z"):
        load_light_list(as_json(tmp_path, content))


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("lights.json", '{"images": [], "images": []}', 'key "images" twice'),
        (
            "lights.json",
            '[{"file": "a.png", "direction": [0, 0, 1], "direction": [1, 0, 1]}]',
            'key "direction" twice',
        ),
        ("lights.json", "[x", r"not JSON \(.*line 1 column 2"),
        ("lights.csv", "0,0,1", r"\.lp or \.json"),
        ("large.lp", b" " * (5 << 20), "larger than"),
    ],
)
def test_a_file_that_is_not_a_light_list_is_named(
    tmp_path: Path, name: str, content: Any, message: str
) -> None:
    with pytest.raises(InputError, match=f"{name}: .*{message}"):
        load_light_list(written(tmp_path, content, name))


@given(st.text(max_size=200), st.sampled_from([".lp", ".json"]))
def test_any_text_is_read_or_refused(
    tmp_path_factory: pytest.TempPathFactory, text: str, suffix: str
) -> None:
    path = tmp_path_factory.getbasetemp() / f"any{suffix}"
    path.write_text(text, encoding="utf-8", errors="replace")
    try:
        load_light_list(path)
    except InputError as error:
        message = str(error)
        assert path.name in message


def test_intensities_beside_directions_are_kept_in_the_order_of_the_images(tmp_path: Path) -> None:
    lights = [
        {"file": f"{name}.png", "direction": [x, y, 1], "intensity": intensity}
        for name, x, y, intensity in (("a", 1, 0, 1.0), ("b", 0, 1, 2.0), ("c", -1, 0, 0.5))
    ]
    found = load_light_list(as_json(tmp_path, lights))
    lighting = found.lighting_for([Path("c.png"), Path("a.png"), Path("b.png")])
    assert lighting.intensities.tolist() == [0.5, 1.0, 2.0]
    assert lighting.intensities_given


@pytest.mark.parametrize("name", ["lights.json", "lights.lp"])
def test_a_written_list_keeps_directions_and_intensities(tmp_path: Path, name: str) -> None:
    for lighting in (RING, replace(RING, intensities=np.array([1.0, 0.7, 1.2, 0.9]))):
        write_light_list(tmp_path / name, lighting, NAMES)
        found = load_light_list(tmp_path / name).lighting_for(PATHS)
        np.testing.assert_allclose(found.directions, lighting.directions, atol=1e-8)
        assert found.intensities.tolist() == lighting.intensities.tolist()
        assert found.intensities_given == lighting.intensities_given


def test_lights_without_a_file_have_no_other_keys(tmp_path: Path) -> None:
    """Else the key may be the name of the image, and the order means nothing."""
    path = as_json(tmp_path, [{"img": "a.png", "direction": [0, 0, 1], "intensity": 1.0}])
    with pytest.raises(InputError, match="not a list of lights"):
        load_light_list(path)


def test_an_lp_line_may_end_in_an_intensity(tmp_path: Path) -> None:
    lines = ["3", "my photo 1.png 1 0 1 0.5", "b.JPG 0 1 1 1", "c.tif -1 0 1 2"]
    found = load_light_list(written(tmp_path, "\n".join(lines)))
    assert found.names == ["my photo 1.png", "b.JPG", "c.tif"]
    assert found.intensities == [0.5, 1.0, 2.0]
    assert found.vectors[0] == (1.0, 0.0, 1.0)
    lines[2] = "b.JPG 0 1 1"
    with pytest.raises(InputError, match="some lights only"):
        load_light_list(written(tmp_path, "\n".join(lines)))


# unknown keys


def named(**more: Any) -> list[dict[str, Any]]:
    pairs = zip(NAMES, VECTORS, strict=True)
    return [{"file": name, "direction": vector, **more} for name, vector in pairs]


@pytest.mark.parametrize("key", [
    "relative_intensity_estimated", "intensty", "relIntensity", "led-level", "brightness",
])  # fmt: skip
def test_a_key_that_looks_like_a_missing_one_is_refused(tmp_path: Path, key: str) -> None:
    path = as_json(tmp_path, {"images": named(**{key: 0.5})})
    with pytest.raises(InputError, match=rf'lights\.json: image 0 .* "{key}", .*"intensity"; re'):
        load_light_list(path)
    found = load_light_list(path, unknown_keys=True)
    assert found.intensities == []
    assert found.warnings[0].endswith(f": {key}")
    assert load_light_list(as_json(tmp_path, named(**{key: 0.5, "intensity": 2.0}))).intensities


def test_intensities_beside_the_images_are_refused(tmp_path: Path) -> None:
    path = as_json(tmp_path, {"images": named(), "intensities": [1, 1, 1, 2]})
    with pytest.raises(InputError, match='unknown key "intensities"'):
        load_light_list(path)


def test_other_unknown_keys_are_named_in_a_warning(tmp_path: Path) -> None:
    """As the lights of public data sets have them."""
    entries = named(tilt_deg=3.0, source_direction=[0, 0, 1], height_mm=3)
    content = {"name": "cat", "images": entries, "intensity_note": "equal", "mask": "m.png"}
    found = load_light_list(as_json(tmp_path, content))
    keys = "name, intensity_note, mask, tilt_deg, source_direction, height_mm"
    assert found.warnings[0].endswith(f": {keys}")
    assert load_light_list(as_json(tmp_path, named())).warnings == []


def test_a_missing_intensity_beside_others_is_named(tmp_path: Path) -> None:
    entries = named()
    entries[1]["intensity"] = 0.5
    found = load_light_list(as_json(tmp_path, entries))
    assert found.intensities == [1.0, 0.5, 1.0, 1.0]
    assert "without an intensity" in found.warnings[0]
