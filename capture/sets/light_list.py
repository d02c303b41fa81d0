"""Light directions of photographs, in an RTI ``.lp`` file or JSON."""

import json
import os
import re
import reprlib
import unicodedata
from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from itertools import takewhile
from pathlib import Path, PureWindowsPath
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from capture.base.names import typed_number
from classify import InputError, Lighting
from classify.base.durable_file import write_text
from classify.base.regular_file import read_regular_file
from classify.lighting import light_fault

_MAX_BYTES = 2**22  # 16 KiB a light
_MAX_LIGHTS = 255  # a captured set has up to 256 images, one of them ambient
_Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]  # no text, no true
_Vector = tuple[_Number, _Number, _Number]
PHOTOGRAPH_SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".tga", ".dng")
_QUOTES = "\"'"
# Line of an RTI list whose name ends like that of a photograph: name and numbers.
_SUFFIX = "|".join(map(re.escape, PHOTOGRAPH_SUFFIXES))
_PHOTOGRAPH_LINE = re.compile(rf"(.*(?:{_SUFFIX})[{_QUOTES}]?)\s(.*)", re.I)
# Words by which a misspelt or foreign name of a key of this format is recognised.
_SIMILAR_KEYS = {
    "intensity": {
        "intensity", "intensities", "brightness", "strength", "strengths", "level", "levels",
        "power", "powers", "gain", "gains", "flux",
    },
    "direction": {"direction", "directions", "vector", "vectors", "light", "dir", "xyz"},
    "file": {"file", "filename", "image", "name", "path", "photo"},
    "images": {"images", "image", "lights", "photos", "photographs", "files"},
}  # fmt: skip
# Similarity (difflib) from which a word is a misspelling: one or two letters of ten differ. It is
# compared with words of `_LONG_WORD` letters or more: short ones are similar to too many others.
_MISSPELT, _LONG_WORD = 0.8, 8


class _Light(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")
    direction: _Vector
    intensity: Annotated[_Number, Field(gt=0.0)] | None = None


class _NamedLight(_Light):
    model_config = ConfigDict(frozen=True, extra="ignore")
    file: str


class _ImagesFile(BaseModel):
    model_config = ConfigDict(frozen=True, extra="ignore")
    images: tuple[_NamedLight, ...]


_EXPECTED_FORM = (
    "not a list of lights; give [[x, y, z], ...] in the order of the images, or "
    '{"images": [{"file": name, "direction": [x, y, z]}, ...]}'
)
_Lists = _ImagesFile | tuple[_NamedLight, ...] | tuple[_Light, ...] | tuple[_Vector, ...]
_JSON: TypeAdapter[_Lists] = TypeAdapter(_Lists)


@dataclass(frozen=True)
class LightList:
    """Light directions of a file, by names of images or in order."""

    source: Path
    names: Sequence[str]  # of images; empty if the file has none
    places: Sequence[str]  # of the lights in the file, such as ``line 3``
    vectors: Sequence[_Vector]
    intensities: Sequence[float]  # empty if the file has none
    warnings: Sequence[str] = ()

    def __post_init__(self) -> None:
        if not 1 <= len(self.vectors) <= _MAX_LIGHTS:
            raise InputError(
                f"{self.source}: lists {len(self.vectors)} lights; 1 to {_MAX_LIGHTS} are handled"
            )

    def image_paths(self) -> list[Path]:
        """Return the paths of the named images, as `listed_files`."""
        return listed_files(self.source, self.names)

    @property
    def inputs(self) -> list[Path]:
        """The list, and all files that its names may mean."""
        names = [*self.names, *(PureWindowsPath(name).name for name in self.names)]
        folder = self.source.parent
        return [self.source, *(file for name in names for file in _files(folder / name))]

    def lighting_for(self, images: Sequence[Path]) -> Lighting:
        """Return the lights of these images, by name, or in order if the file has no names."""
        if not self.names and len(images) != len(self.vectors):
            raise InputError(
                f"{self.source}: {len(self.vectors)} lights for {len(images)} images; "
                "give one each, in the same order"
            )
        rows = [*map(self._row_of, images)] if self.names else [*range(len(images))]
        for number, row in enumerate(rows):
            place = ", ".join((self.places[row], *self.names[row : row + 1]))
            if row in rows[:number]:
                first = images[rows.index(row)]
                raise InputError(
                    f"{self.source}: {first} and {images[number]} both have the light of {place}; "
                    "list one image for each light"
                )
            intensity = self.intensities[row] if self.intensities else 1.0
            if fault := light_fault(self.vectors[row], intensity):
                raise InputError(f"{self.source}: {place}: the light {fault}")
        intensities = [self.intensities[row] for row in rows] if self.intensities else []
        return Lighting(np.array(self.vectors)[rows], np.array(intensities))

    def _row_of(self, image: Path) -> int:
        """Row of an image; among equal file names, the row that shares the most parent folders."""
        shared = {
            row: _shared_end(self.source.parent / name, image)
            for row, name in enumerate(self.names)
            if _composed(PureWindowsPath(name).name) == _composed(image.name)
        }
        if not shared:
            name = image.name.casefold()
            same_but_case = [
                listed for listed in self.names if PureWindowsPath(listed).name.casefold() == name
            ]
            hint = f", but for {same_but_case[0]}; rename one of them" if same_but_case else ""
            raise InputError(f"{self.source}: lists no light for {image.name}{hint}")
        rows = [row for row, parts in shared.items() if parts == max(shared.values())]
        if len(rows) > 1:
            places = " or ".join(self.places[row] for row in rows)
            raise InputError(
                f"{self.source}: {image} may be that of {places}; give the folder of the image as "
                "the list does, or let no name occur twice"
            )
        return rows[0]


def listed_files(source: Path, names: Sequence[str]) -> list[Path]:
    """Paths of the listed images: as written in the list, or beside the list."""
    as_written = [_files(source.parent / name) for name in names]
    beside_list = [_files(source.parent / PureWindowsPath(name).name) for name in names]
    # If no listed folder exists, the list was moved here with its images.
    is_moved = not any(files for files, name in zip(as_written, names, strict=True) if "/" in name)
    paths: list[Path] = []
    for name, listed, namesakes in zip(names, as_written, beside_list, strict=True):
        files = {(path.stat().st_dev, path.stat().st_ino): path for path in (*namesakes, *listed)}
        if len(files) > 1:
            raise InputError(
                f"{source}: {name} may be {' or '.join(map(str, files.values()))}; remove or "
                "rename one, or name the images themselves"
            )
        existing = listed or (namesakes if is_moved else [])
        paths.append(existing[0] if existing else source.parent / name)
    twice = [path for path, count in Counter(map(os.path.abspath, paths)).items() if count > 1]
    if twice:
        raise InputError(f"{source}: names image {twice[0]} twice; list one light for each image")
    return paths


def _files(path: Path) -> list[Path]:
    """Files that exist and differ from `path` at most in the Unicode form of their names."""
    places = [Path()]
    for part in path.parts:
        if part.isascii():
            places = [place / part for place in places]
        else:
            below = (path for place in filter(os.path.isdir, places) for path in place.iterdir())
            places = [path for path in below if _composed(path.name) == _composed(part)]
    return [*filter(os.path.isfile, places)]


def _shared_end(one: Path, other: Path) -> int:
    """Number of names that two paths share at their ends."""
    ends = (Path(_composed(path)).parts[::-1] for path in map(os.path.abspath, (one, other)))
    return sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], zip(*ends, strict=False)))


def _composed(name: str) -> str:
    return unicodedata.normalize("NFC", name)


def load_light_list(path: Path, *, unknown_keys: bool = False) -> LightList:
    """Read the lights of a ``.lp`` or ``.json`` file.

    Keys that look like a misspelt one are refused, unless `unknown_keys` ignores them.
    """
    text = light_list_text(path)
    if path.suffix.lower() == ".lp":
        return _parsed_lp(path, text)
    if path.suffix.lower() == ".json":
        return _parsed_json(path, text, unknown_keys)
    raise InputError(f"{path}: light directions come as .lp or .json")


def light_list_text(path: Path) -> str:
    """Text of a list in UTF-8, or in UTF-16 with a byte order mark."""
    content = read_regular_file(path, _MAX_BYTES)
    coding = "UTF-16" if content.startswith((BOM_UTF16_LE, BOM_UTF16_BE)) else "UTF-8"
    try:
        return content.decode(coding).removeprefix("\ufeff")
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise InputError(f"{path}: line {line} is not {coding} text; save it as UTF-8") from error


def _parsed_lp(path: Path, text: str) -> LightList:
    lines = [line.strip() for line in text.splitlines()]
    numbered = [(number, line) for number, line in enumerate(lines, start=1) if line]
    number, count = numbered[0] if numbered else (1, "")
    if not count.isdecimal():
        raise InputError(f"{path}: line {number} must be the number of lights, not {count[:120]!r}")
    names, vectors, intensities, places = [], [], [], []
    for number, line in numbered[1:]:
        # A name may contain blanks, and folders of another computer.
        photograph = _PHOTOGRAPH_LINE.fullmatch(line)
        name, *fields = line.rsplit(maxsplit=3)
        if photograph is not None:
            name, fields = photograph[1], photograph[2].split()
        try:
            x, y, z, *intensity = map(typed_number, fields)
            if len(intensity) > 1:
                raise ValueError
        except ValueError:
            raise InputError(
                f"{path}: line {number} is not 'name x y z' or 'name x y z intensity' with decimal "
                f"points: {line[:120]!r}"
            ) from None
        names.append(name.strip(_QUOTES).replace("\\", "/"))
        places.append(f"line {number}")
        vectors.append((x, y, z))
        intensities += intensity
    announced = int(count[:9])  # more digits than any list needs
    if announced != len(vectors):
        raise InputError(f"{path}: announces {announced} lights and lists {len(vectors)}")
    if len(intensities) not in (0, len(vectors)):
        raise InputError(f"{path}: gives the intensity of some lights only; give all or none")
    return LightList(path, names, places, vectors, intensities)


def _parsed_json(path: Path, text: str, unknown_keys: bool) -> LightList:
    try:
        raw = json.loads(text, object_pairs_hook=_without_repeats)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    except json.JSONDecodeError as error:
        raise InputError(f"{path}: not JSON ({error})") from error
    except (ValueError, RecursionError):  # a number of thousands of digits, nested too deep
        raise InputError(f"{path}: {_EXPECTED_FORM}") from None
    ignored = [*_unknown_keys(raw)]
    for place, key, similar in ignored:
        if similar is not None and not unknown_keys:
            raise InputError(
                f'{path}: {place} has the unknown key "{key}", which looks like "{similar}"; '
                "rename it if it is that, or give --accept light-keys to ignore it"
            )
    try:
        content = _JSON.validate_python(raw)
    except ValidationError as error:
        raise InputError(f"{path}: {_EXPECTED_FORM}{_first_fault(error)}") from None
    entries = content.images if isinstance(content, _ImagesFile) else content
    names = [light.file.replace("\\", "/") for light in entries if isinstance(light, _NamedLight)]
    places = [f"image {number}" for number in range(len(entries))]
    vectors = [light.direction if isinstance(light, _Light) else light for light in entries]
    stated = [light.intensity if isinstance(light, _Light) else None for light in entries]
    any_stated = any(intensity is not None for intensity in stated)
    intensities = (
        [1.0 if intensity is None else intensity for intensity in stated] if any_stated else []
    )
    warnings = []
    if ignored:
        keys = ", ".join(dict.fromkeys(key for _, key, _ in ignored))
        warnings.append(f"{path.name}: unknown keys are ignored: {keys}")
    if any_stated and None in stated:
        warnings.append(f"{path.name}: lights without an intensity count as of intensity 1")
    return LightList(path, names, places, vectors, intensities, warnings)


def _without_repeats(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    content = dict(pairs)
    if len(content) < len(pairs):
        twice = next(key for key, count in Counter(key for key, _ in pairs).items() if count > 1)
        raise InputError(f'gives the key "{twice}" twice in one entry; remove one of them')
    return content


def _first_fault(error: ValidationError) -> str:
    """Place, fault and value of the entry at fault; may be empty."""
    # The error with the longest path is of the form that the file most likely has.
    deepest = max(error.errors(), key=lambda fault: len(fault["loc"]))
    place = ".".join(map(str, deepest["loc"][1:]))
    return place and f"; {place}: {deepest['msg']}, not {reprlib.repr(deepest['input'])}"


def _unknown_keys(content: Any) -> Iterator[tuple[str, str, str | None]]:
    """Place and name of each unknown key, and the missing key with a similar name."""
    listed = content.get("images") if isinstance(content, dict) else content
    images = listed if isinstance(listed, list) else []
    entries = [entry for entry in images if isinstance(entry, dict)]
    light_keys = [*_NamedLight.model_fields]
    if isinstance(content, dict):
        missing = [] if isinstance(listed, list) else ["images"]
        missing += [] if any("intensity" in entry for entry in entries) else ["intensity"]
        for key in content:
            if key != "images":
                yield "the file", key, _look_alike(key, content[key], missing)
    for number, entry in enumerate(entries):
        missing = [key for key in light_keys if key not in entry]
        for key in entry:
            if key not in light_keys:
                yield f"image {number}", key, _look_alike(key, entry[key], missing)


def _look_alike(key: str, value: Any, missing: Iterable[str]) -> str | None:
    """Return the missing key that `key` is a variant or a misspelling of, if any."""
    words = {word.lower() for word in re.findall(r"[A-Z]?[a-z]+|[A-Z]+", key)}
    for candidate in missing:
        if candidate == "intensity" and (value is None or isinstance(value, str)):
            continue  # a remark
        similar = _SIMILAR_KEYS[candidate]
        long = [word for word in similar if len(word) >= _LONG_WORD]
        if words & similar or any(get_close_matches(w, long, 1, _MISSPELT) for w in words):
            return candidate
    return None


def require_light_list_name(path: Path) -> None:
    """Raise `InputError` if the name of a list of lights has another ending."""
    if path.suffix.lower() not in (".lp", ".json"):
        raise InputError(f"{path}: the name of a list of lights must end in .lp or .json")


def write_light_list(path: Path, lighting: Lighting, names: Sequence[str]) -> None:
    """Write ``.lp`` with names or ``.json`` in order, and the intensities if they are known."""
    require_light_list_name(path)
    vectors = [[round(value, 9) for value in row] for row in lighting.directions.tolist()]
    levels = [round(level, 6) for level in lighting.intensities.tolist()]
    pairs = [*zip(vectors, levels, strict=True)]
    has_levels = lighting.intensities_given
    if path.suffix.lower() == ".json":
        entries = [
            {"direction": vector, "intensity": level} if has_levels else vector
            for vector, level in pairs
        ]
        text = "[\n" + ",\n".join(f" {json.dumps(entry)}" for entry in entries) + "\n]\n"
    else:
        rows = [[*vector, level] if has_levels else vector for vector, level in pairs]
        lines = (f"{name} {' '.join(map(str, row))}" for name, row in zip(names, rows, strict=True))
        text = "\n".join([str(len(rows)), *lines]) + "\n"
    write_text(path, text)
