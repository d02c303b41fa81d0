"""Light directions of photographs, from an RTI ``.lp`` file or JSON."""

import json
import re
import reprlib
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path, PureWindowsPath
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from classify import Lighting
from classify.errors import InputError
from classify.regular_file import read_regular_file

_MAX_BYTES = 2**22  # 16 KiB a light
_MAX_LIGHTS = 255  # a captured set has up to 256 images, one of them ambient
_Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]  # no text, no true
Vector = tuple[_Number, _Number, _Number]
PHOTOGRAPH_SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".tga", ".dng")
# Words in the names that others give to the keys of this format.
_ALIKE = {
    "intensity": {
        "intensity", "intensities", "brightness", "strength", "strengths", "level", "levels",
        "power", "powers", "gain", "gains", "flux",
    },
    "direction": {"direction", "directions", "vector", "vectors", "light", "dir", "xyz"},
    "file": {"file", "filename", "image", "name", "path", "photo"},
    "images": {"images", "image", "lights", "photos", "photographs", "files"},
}  # fmt: skip
# A word is a misspelling of a known one of at least `_LONG_WORD` letters if their similarity is at
# least `_MISSPELT`: one or two letters of ten differ. A short word is similar to too many others.
_MISSPELT, _LONG_WORD = 0.8, 8


class _NamedLight(BaseModel):
    model_config = ConfigDict(frozen=True, extra="ignore")
    file: str
    direction: Vector
    intensity: Annotated[_Number, Field(gt=0.0)] | None = None


class _ImagesFile(BaseModel):
    model_config = ConfigDict(frozen=True, extra="ignore")
    images: tuple[_NamedLight, ...]


_FORM = (
    "not a list of lights; give [[x, y, z], ...] in the order of the images, or "
    '{"images": [{"file": name, "direction": [x, y, z]}, ...]}'
)
_JSON: TypeAdapter[_ImagesFile | tuple[_NamedLight, ...] | tuple[Vector, ...]] = TypeAdapter(
    _ImagesFile | tuple[_NamedLight, ...] | tuple[Vector, ...]
)


@dataclass(frozen=True)
class LightList:
    """Light directions of a file, by image name or in order.

    Attributes
    ----------
    source
        The file. The images that it names are in the same folder.
    names
        Image names without folder, one per vector, or empty if the vectors are in order.
    vectors
        (x, y, z) towards each light; x right, y up, z to the camera.
    intensities
        Intensity of each light relative to the others; empty if the file gives none.
    warnings
        Ignored keys and assumptions.

    Raises
    ------
    InputError
        For no light, more than 255 lights, or a name that occurs twice.
    """

    source: Path
    names: Sequence[str]
    vectors: Sequence[Vector]
    intensities: Sequence[float]
    warnings: Sequence[str] = ()

    def __post_init__(self) -> None:
        if not 1 <= len(self.vectors) <= _MAX_LIGHTS:
            raise InputError(
                f"{self.source}: lists {len(self.vectors)} lights; 1 to {_MAX_LIGHTS} are handled"
            )
        twice = [name for name, count in Counter(self.names).items() if count > 1]
        if twice:
            raise InputError(f"{self.source}: names image {twice[0]} twice")

    def image_paths(self) -> list[Path]:
        """Return the paths of the named images; empty if the file gives no names."""
        return [self.source.parent / name for name in self.names]

    def lighting_for(self, images: Sequence[Path]) -> Lighting:
        """Return the lights of these images, by name, or in order if the file has no names.

        Raises
        ------
        InputError
            If an image is not listed, the counts differ, or `Lighting` refuses a light.
        """
        if not self.names and len(images) != len(self.vectors):
            raise InputError(
                f"{self.source}: {len(self.vectors)} lights for {len(images)} images; "
                "give one each, in the same order"
            )
        rows = list(range(len(images)))
        if self.names:
            missing = [image.name for image in images if image.name not in self.names]
            if missing:
                raise InputError(f"{self.source}: lists no light for {missing[0]}")
            rows = [self.names.index(image.name) for image in images]
        try:
            intensities = [self.intensities[row] for row in rows] if self.intensities else []
            return Lighting(np.array(self.vectors)[rows], np.array(intensities))
        except InputError as error:
            raise InputError(f"{self.source}: {error}") from error


def load_light_list(path: Path, *, unknown_keys: bool = False) -> LightList:
    """Read ``.lp`` (a count, then one ``name x y z`` per line) or ``.json``.

    JSON may be a list of ``[x, y, z]`` in the order of the images, a list of ``{"file": name,
    "direction": [x, y, z]}``, or an object with such a list under ``images``. An entry may have
    ``"intensity": number``, relative to the other lights; so may a line of ``.lp``, at its end.

    Parameters
    ----------
    unknown_keys
        Whether to ignore keys of JSON that look like a missing one, such as
        ``relative_intensity``. Other unknown keys are always ignored. The warnings name them all.

    Raises
    ------
    InputError
        If the file is missing or has another form, or a key looks like a missing one; the message
        names file and line.
    """
    try:
        text = read_regular_file(path, _MAX_BYTES).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: cannot be read ({error})") from error
    if path.suffix.lower() == ".lp":
        return _parsed_lp(path, text)
    if path.suffix.lower() == ".json":
        return _parsed_json(path, text, unknown_keys)
    raise InputError(f"{path}: light directions come as .lp or .json")


def _parsed_lp(path: Path, text: str) -> LightList:
    lines = [line.strip() for line in text.splitlines()]
    numbered = [(number, line) for number, line in enumerate(lines, start=1) if line]
    if not numbered or not numbered[0][1].isdecimal():
        raise InputError(f"{path}: line 1 must be the number of lights")
    names: list[str] = []
    vectors: list[Vector] = []
    intensities: list[float] = []
    for number, line in numbered[1:]:
        # A name may contain blanks, and folders of another computer.
        name, *fields = line.rsplit(maxsplit=3)
        longer = line.rsplit(maxsplit=4)
        if longer[0].lower().endswith(PHOTOGRAPH_SUFFIXES):
            name, *fields = longer
        try:
            x, y, z, *more = map(float, fields)
        except ValueError:
            raise InputError(f"{path}: line {number} is not 'name x y z'") from None
        names.append(PureWindowsPath(name).name)
        vectors.append((x, y, z))
        intensities += more
    announced = int(numbered[0][1][:9])  # more digits than any list needs
    if announced != len(vectors):
        raise InputError(f"{path}: announces {announced} lights and lists {len(vectors)}")
    if len(intensities) not in (0, len(vectors)):
        raise InputError(f"{path}: gives the intensity of some lights only; give all or none")
    return LightList(path, names, vectors, intensities)


def _parsed_json(path: Path, text: str, unknown_keys: bool) -> LightList:
    try:
        raw = json.loads(text)
    except json.JSONDecodeError as error:
        raise InputError(f"{path}: not JSON ({error})") from error
    except (ValueError, RecursionError):  # a number of thousands of digits, nested too deep
        raise InputError(f"{path}: {_FORM}") from None
    ignored = [*_unknown_keys(raw)]
    for place, key, known in ignored:
        if known is not None and not unknown_keys:
            raise InputError(
                f'{path}: {place} has the unknown key "{key}", which looks like "{known}"; '
                "rename it if it is that, or give --accept light-keys to ignore it"
            )
    try:
        content = _JSON.validate_python(raw)
    except ValidationError as error:
        raise InputError(f"{path}: {_FORM}{_first_fault(error)}") from None
    entries = content.images if isinstance(content, _ImagesFile) else content
    names = [PureWindowsPath(e.file).name for e in entries if isinstance(e, _NamedLight)]
    vectors = [e.direction if isinstance(e, _NamedLight) else e for e in entries]
    given = [e.intensity if isinstance(e, _NamedLight) else None for e in entries]
    any_given = any(intensity is not None for intensity in given)
    intensities = [1.0 if each is None else each for each in given] if any_given else []
    warnings = []
    if ignored:
        keys = ", ".join(dict.fromkeys(key for _, key, _ in ignored))
        warnings.append(f"{path.name}: unknown keys are ignored: {keys}")
    if any_given and None in given:
        warnings.append(f"{path.name}: lights without an intensity count as of intensity 1")
    return LightList(path, names, vectors, intensities, warnings)


def _first_fault(error: ValidationError) -> str:
    """Place, fault and value of the entry at fault; may be empty."""
    # The form that fits best is the one whose check gets deepest into the file.
    deepest = max(error.errors(), key=lambda each: len(each["loc"]))
    place = ".".join(map(str, deepest["loc"][1:]))
    return place and f"; {place}: {deepest['msg']}, not {reprlib.repr(deepest['input'])}"


def _unknown_keys(content: Any) -> Iterator[tuple[str, str, str | None]]:
    """Place, name, and the missing key that it looks like, of each key that is not read."""
    listed = content.get("images") if isinstance(content, dict) else content
    images = listed if isinstance(listed, list) else []
    entries = [each for each in images if isinstance(each, dict)]
    known = [*_NamedLight.model_fields]
    if isinstance(content, dict):
        missing = [] if isinstance(listed, list) else ["images"]
        missing += [] if any("intensity" in entry for entry in entries) else ["intensity"]
        for key in content:
            if key != "images":
                yield "the file", key, _look_alike(key, content[key], missing)
    for number, entry in enumerate(entries):
        missing = [key for key in known if key not in entry]
        for key in entry:
            if key not in known:
                yield f"image {number}", key, _look_alike(key, entry[key], missing)


def _look_alike(key: str, value: Any, missing: Iterable[str]) -> str | None:
    """Return the missing key that `key` is a variant or a misspelling of, if any."""
    words = {word.lower() for word in re.findall(r"[A-Z]?[a-z]+|[A-Z]+", key)}
    for known in missing:
        if known == "intensity" and (value is None or isinstance(value, str)):
            continue  # a remark
        long = [word for word in _ALIKE[known] if len(word) >= _LONG_WORD]
        if words & _ALIKE[known] or any(get_close_matches(w, long, 1, _MISSPELT) for w in words):
            return known
    return None
