"""Files of captured sets: round trips, other readers, and files that are refused."""

import json
import xml.etree.ElementTree as ET
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from capture import CapturedSet
from capture.sets.metadata import ImageRecord
from classify import Lighting
from classify.base.errors import InputError
from rig.set_file import fields_sha256

MadeSet = Callable[..., CapturedSet]
DATA = Path(__file__).parents[2] / "data" / "sets"
PIXELS = np.arange(5 * 6 * 7, dtype=np.uint16).reshape(5, 6, 7)
OME = "{http://www.openmicroscopy.org/Schemas/OME/2016-06}"

printable = st.text(max_size=30).filter(str.isprintable)
planes = st.tuples(st.integers(4, 9), st.integers(1, 24), st.integers(1, 24)).flatmap(
    lambda shape: hnp.arrays(np.uint16, shape)
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("sets")


@pytest.fixture
def path(tmp_path: Path, made_set: MadeSet) -> Path:
    """A file with a small set."""
    made_set(PIXELS[:4], PIXELS[4]).save(tmp_path / "oak.ome.tif")
    return tmp_path / "oak.ome.tif"


def with_metadata(path: Path, change: Callable[[dict[str, Any]], object], sign: bool) -> None:
    """Edit the JSON inside the file, as a person with a script would; `sign` renews its hash."""
    with tifffile.TiffFile(path) as tiff:
        root = ET.fromstring(tiff.pages.first.description)
        pixels = tiff.asarray(key=range(len(tiff.pages)))
    value = root.find(f".//{OME}CommentAnnotation/{OME}Value")
    assert value is not None
    assert value.text is not None
    fields = json.loads(value.text)
    change(fields)
    if sign:
        fields["sha256"] = fields_sha256(fields)
    value.text = json.dumps(fields)
    tifffile.imwrite(path, pixels, photometric="minisblack", description=ET.tostring(root),
                     metadata=None)  # fmt: skip


# round trips


@settings(max_examples=60, deadline=None)
@given(
    images=planes,
    with_ambient=st.booleans(),
    label=st.none() | printable,
    mm_per_px=st.none() | st.floats(1e-6, 1e3),
)
def test_pixels_and_metadata_come_back_as_they_were(
    folder: Path,
    made_set: MadeSet,
    images: Any,
    with_ambient: bool,
    label: str | None,
    mm_per_px: float | None,
) -> None:
    ambient = images[-1] if with_ambient else None
    lights = images[:-1] if with_ambient else images
    written = made_set(lights, ambient, label=label, mm_per_px=mm_per_px)
    written.save(folder / "x.ome.tif")
    with tifffile.TiffFile(folder / "x.ome.tif") as tiff:
        assert tiff.pages.first.description.isascii()
    read = CapturedSet.load(folder / "x.ome.tif")
    assert read.metadata == written.metadata
    assert read.lighting == written.lighting
    np.testing.assert_array_equal(read.images, written.images)
    if ambient is None:
        assert read.ambient is None
    else:
        np.testing.assert_array_equal(read.ambient, ambient)


def test_file_names_that_xml_cannot_hold_come_back(path: Path, made_set: MadeSet) -> None:
    names = ["a\x01.png", "\uffff.png", "tab\t.png", "\u2028.png"]
    records = tuple(ImageRecord(light=i, source_file=name) for i, name in enumerate(names))
    made_set(np.ones((4, 2, 2), np.uint16), images=records).save(path)
    assert [image.source_file for image in CapturedSet.load(path).metadata.images] == names


@pytest.mark.parametrize("given", [True, False])
def test_a_set_knows_whether_its_intensities_were_given(
    tmp_path: Path, made_set: MadeSet, given: bool
) -> None:
    lighting = Lighting(Lighting.ring().directions, np.ones(4) if given else np.empty(0))
    made_set(PIXELS[:4], lighting=lighting).save(tmp_path / "a.ome.tif")
    assert CapturedSet.load(tmp_path / "a.ome.tif").lighting.intensities_given == given


# other readers


def test_tiff_readers_see_channels_named_by_tilt(path: Path) -> None:
    with tifffile.TiffFile(path) as tiff:
        assert tiff.is_ome
        assert tiff.series[0].axes == "CYX"
        assert tiff.series[0].shape == (5, 6, 7)
        np.testing.assert_array_equal(tiff.asarray(), PIXELS)
        assert tiff.pages.first.compression == tifffile.COMPRESSION.NONE
        root = ET.fromstring(tiff.ome_metadata or "")
    names = [channel.get("Name") for channel in root.iter(f"{OME}Channel")]
    assert names == ["tilt 0 deg", "tilt 90 deg", "tilt 180 deg", "tilt 270 deg", "ambient"]


def test_a_known_scale_is_the_physical_size_of_a_pixel(tmp_path: Path, made_set: MadeSet) -> None:
    made_set(PIXELS[:4], PIXELS[4], mm_per_px=0.02).save(tmp_path / "a.ome.tif")
    assert CapturedSet.load(tmp_path / "a.ome.tif").metadata.mm_per_px == 0.02
    with tifffile.TiffFile(tmp_path / "a.ome.tif") as tiff:
        size = ET.fromstring(tiff.ome_metadata or "").find(f".//{OME}Pixels")
        page = tiff.pages.first
        assert page.get_resolution("MILLIMETER") == pytest.approx((50.0, 50.0))
    assert size is not None
    assert {name: text for name, text in size.items() if name.startswith("Physical")} == {
        "PhysicalSizeX": "0.02", "PhysicalSizeXUnit": "mm",
        "PhysicalSizeY": "0.02", "PhysicalSizeYUnit": "mm",
    }  # fmt: skip


def test_opposite_lights_have_complementary_colours(path: Path) -> None:
    with tifffile.TiffFile(path) as tiff:
        root = ET.fromstring(tiff.ome_metadata or "")
    colours = [int(channel.get("Color") or 0) for channel in root.iter(f"{OME}Channel")]
    rgba = [colour.to_bytes(4, "big", signed=True) for colour in colours]
    assert all(a + b == 255 for a, b in zip(rgba[0][:3], rgba[2][:3], strict=True))
    assert all(abs(a + b - 255) <= 1 for a, b in zip(rgba[1][:3], rgba[3][:3], strict=True))
    assert {each[3] for each in rgba} == {255}
    assert rgba[4] == b"\xff\xff\xff\xff"


def test_the_ome_xml_has_the_structure_of_the_2016_schema(path: Path) -> None:
    with tifffile.TiffFile(path) as tiff:
        root = ET.fromstring(tiff.pages.first.description)
    assert root.tag == f"{OME}OME"
    assert [child.tag for child in root] == [f"{OME}Image", f"{OME}StructuredAnnotations"]
    image, annotations = root
    # An xsd:sequence: the order of these is prescribed.
    assert [child.tag.removeprefix(OME) for child in image] == [
        "AcquisitionDate", "Pixels", "AnnotationRef",
    ]  # fmt: skip
    pixels = image[1]
    assert [child.tag.removeprefix(OME) for child in pixels] == ["Channel"] * 5 + ["TiffData"]
    assert {name: pixels.get(name) for name in ("DimensionOrder", "Type", "SizeX", "SizeC")} == {
        "DimensionOrder": "XYCZT", "Type": "uint16", "SizeX": "7", "SizeC": "5",
    }  # fmt: skip
    assert image[2].get("ID") == annotations[0].get("ID") == "Annotation:0"
    assert image.get("Name") == "oak"


# refused files


def test_a_file_cut_off_anywhere_is_refused_by_name(path: Path, tmp_path: Path) -> None:
    whole = path.read_bytes()
    # The last 20 bytes hold the resolution of the last page, which is not read.
    last = len(whole) - 20
    cut = tmp_path / "cut.ome.tif"
    lengths = {*range(0, 400, 7), *range(0, last, 97), *range(last - 200, last)}
    for length in sorted(lengths):
        cut.write_bytes(whole[:length])
        with pytest.raises(InputError, match=r"cut\.ome\.tif: "):
            CapturedSet.load(cut)


@settings(max_examples=150, deadline=None)
@given(place=st.floats(0, 1, exclude_max=True), bit=st.integers(0, 7))
def test_a_flipped_bit_is_refused_or_changes_neither_pixels_nor_metadata(
    folder: Path, made_set: MadeSet, place: float, bit: int
) -> None:
    images = np.arange(4 * 40 * 40, dtype=np.uint16).reshape(4, 40, 40)
    path = folder / "flipped.ome.tif"
    whole = made_set(images)
    whole.save(path)
    content = bytearray(path.read_bytes())
    content[int(place * len(content))] ^= 1 << bit
    path.write_bytes(content)
    with suppress(InputError):
        read = CapturedSet.load(path)
        np.testing.assert_array_equal(read.images, images)
        assert read.metadata == whole.metadata


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda f: f.update(schema_version=5), "version 5, .* 6; use"),
        (lambda f: f.update(schema_version=7), "version 7, .* 6; use"),
        (lambda f: f.pop("schema_version"), "version None, "),
        (lambda f: f.update(full_scale=0), "metadata field full_scale: "),
        (lambda f: f["images"].pop(), "holds 5 images, .* 4"),
        (lambda f: f.update(mask_file="m.png"), "holds 5 images, .* 6"),
        (lambda f: f["lighting"]["directions"].pop(), "in order|intensities for 3 lights"),
        (lambda f: f["lighting"]["directions"][1].__setitem__(2, -1), "light 1 stands"),
        (lambda f: f["lighting"]["intensities"].__setitem__(0, 0), "light 0 has the intensity 0"),
        (lambda f: f.update(pixels_sha256="00"), "the pixels .* SHA-256"),
        (lambda f: f.update(label="a\x1b"), "metadata field label: .*printable"),
    ],
)
def test_an_error_in_the_metadata_names_file_and_field(
    path: Path, change: Callable[[dict[str, Any]], object], message: str
) -> None:
    with_metadata(path, change, sign=True)
    with pytest.raises(InputError, match=rf"oak\.ome\.tif: .*{message}"):
        CapturedSet.load(path)


@pytest.mark.parametrize("change", [
    lambda f: f["lighting"]["directions"].reverse(), lambda f: f.update(label="ash"),
    lambda f: f.pop("sha256"), lambda f: f.update(orientation_deg=1.0),
])  # fmt: skip
def test_metadata_edited_by_hand_are_noticed(path: Path, change: Any) -> None:
    with_metadata(path, change, sign=False)
    with pytest.raises(InputError, match=r"oak\.ome\.tif: the metadata .* SHA-256"):
        CapturedSet.load(path)


def test_a_small_file_that_declares_gigabytes_is_refused(path: Path) -> None:
    """Compressed zeros take no space, and a page may declare more rows than there are."""
    with tifffile.TiffFile(path) as tiff:
        description = tiff.pages.first.description
    zeros = np.zeros((5, 600, 700), np.uint16)
    about = {"description": description, "metadata": None, "photometric": "minisblack"}
    tifffile.imwrite(path, zeros, compression="zlib", **about)
    with pytest.raises(InputError, match=r"oak\.ome\.tif: .*compressed"):
        CapturedSet.load(path)
    tifffile.imwrite(path, zeros, rowsperstrip=1, **about)
    with tifffile.TiffFile(path, mode="r+b") as tiff:
        for page in tiff.pages:
            page.tags["ImageLength"].overwrite(30_000)
    with pytest.raises(InputError, match=r"oak\.ome\.tif: declares more"):
        CapturedSet.load(path)


def test_the_kept_set_is_read() -> None:
    kept = CapturedSet.load(DATA / "rock.ome.tif")
    about = kept.metadata
    assert (kept.label, about.specimen, about.note) == ("rock", "rock-07", "right edge")
    assert [entry.before for entry in about.corrections] == ["left edge"]
    assert kept.solve().valid.all()


def test_a_mask_is_the_last_page(tmp_path: Path, made_set: MadeSet) -> None:
    mask = np.zeros(PIXELS.shape[1:], np.bool_)
    mask[2:5, 1:4] = True
    for ambient in (None, PIXELS[4]):
        path = tmp_path / f"{ambient is None}.ome.tif"
        written = made_set(PIXELS[:4], ambient, mask=mask)
        written.save(path)
        read = CapturedSet.load(path)
        assert read.mask is not None
        np.testing.assert_array_equal(read.mask, mask)
        assert read.metadata == written.metadata
        assert (read.ambient is None) == (ambient is None)
        with tifffile.TiffFile(path) as tiff:
            assert tiff.is_ome
            assert tiff.series[0].shape == (len(written.metadata.images) + 1, 6, 7)
            np.testing.assert_array_equal(tiff.pages[-1].asarray() == 65535, mask)
            assert 'Name="mask"' in tiff.pages.first.description


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (b'{"schema', b'["schema', "not valid JSON"),
        (b"<Value>", b"<value>", "not a captured set"),
        (b"ps4rig/captured-set", b"ps4rig/captured-cat", "not a captured set"),
    ],
)
def test_metadata_that_cannot_be_read_are_refused(
    path: Path, old: bytes, new: bytes, message: str
) -> None:
    path.write_bytes(path.read_bytes().replace(old, new))
    with pytest.raises(InputError, match=rf"oak\.ome\.tif: .*{message}"):
        CapturedSet.load(path)


def test_other_files_are_named(tmp_path: Path) -> None:
    plain, text, empty = (tmp_path / name for name in ("p.tif", "t.ome.tif", "e.ome.tif"))
    tifffile.imwrite(plain, np.zeros((4, 5, 6), np.uint16), photometric="minisblack")
    text.write_text("no image at all")
    empty.touch()
    for path, message in (
        (plain, "a TIFF, but not a captured set, or cut short; ps4rig import makes one"),
        (text, "not a readable TIFF"),
        (empty, "not a readable TIFF"),
        (tmp_path, "cannot be read: Is a directory"),
        (tmp_path / "none.ome.tif", "no such file"),
    ):
        with pytest.raises(InputError, match=f"{path.name}: {message}"):
            CapturedSet.load(path)


# writing


def test_another_suffix_or_pixel_hash_is_refused(tmp_path: Path, made_set: MadeSet) -> None:
    whole = made_set(np.ones((4, 2, 2), np.uint16))
    with pytest.raises(InputError, match=r"a\.tif: .*\.ome\.tif"):
        whole.save(tmp_path / "a.tif")
    other = CapturedSet(whole.images + np.uint16(1), whole.ambient, whole.metadata)
    with pytest.raises(InputError, match="pixels_sha256 in the metadata"):
        other.save(tmp_path / "other.ome.tif")
    assert list(tmp_path.iterdir()) == []


def test_many_lights_fit_into_one_file(tmp_path: Path, made_set: MadeSet) -> None:
    lighting = Lighting.ring(45.0, list(np.arange(255) * 360 / 255))
    images = np.ones((255, 2, 3), np.uint16)
    made_set(images, images[0], lighting).save(tmp_path / "many.ome.tif")
    assert len(CapturedSet.load(tmp_path / "many.ome.tif").images) == 255
