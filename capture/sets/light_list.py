"""Light directions of photographs, from an RTI ``.lp`` file or JSON."""

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PureWindowsPath

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, TypeAdapter

from classify import Lighting
from classify.errors import InputError
from classify.regular_file import read_regular_file

_MAX_BYTES = 2**22  # 16 KiB a light
_MAX_LIGHTS = 255  # a captured set has up to 256 images, one of them ambient
Vector = tuple[FiniteFloat, FiniteFloat, FiniteFloat]


class _NamedLight(BaseModel):
    model_config = ConfigDict(frozen=True, extra="ignore")
    file: str
    direction: Vector
    intensity: float | None = Field(default=None, gt=0.0, allow_inf_nan=False)


class _ImagesFile(BaseModel):
    model_config = ConfigDict(frozen=True, extra="ignore")
    images: tuple[_NamedLight, ...]


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

    Raises
    ------
    InputError
        For no light, more than 255 lights, or a name that occurs twice.
    """

    source: Path
    names: Sequence[str]
    vectors: Sequence[Vector]
    intensities: Sequence[float]

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


def load_light_list(path: Path) -> LightList:
    """Read ``.lp`` (a count, then one ``name x y z`` per line) or ``.json``.

    JSON may be a list of ``[x, y, z]`` in the order of the images, a list of ``{"file": name,
    "direction": [x, y, z]}``, or an object with such a list under ``images``. An entry may have
    ``"intensity": number``, relative to the other lights.

    Raises
    ------
    InputError
        If the file is missing or has another form; the message names file and line.
    """
    try:
        text = read_regular_file(path, _MAX_BYTES).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: cannot be read ({error})") from error
    if path.suffix.lower() == ".lp":
        return _parsed_lp(path, text)
    if path.suffix.lower() == ".json":
        return _parsed_json(path, text)
    raise InputError(f"{path}: light directions come as .lp or .json")


def _parsed_lp(path: Path, text: str) -> LightList:
    lines = [line.strip() for line in text.splitlines()]
    numbered = [(number, line) for number, line in enumerate(lines, start=1) if line]
    if not numbered or not numbered[0][1].isdecimal():
        raise InputError(f"{path}: line 1 must be the number of lights")
    names: list[str] = []
    vectors: list[Vector] = []
    for number, line in numbered[1:]:
        # A name may contain blanks, and folders of another computer.
        name, *fields = line.rsplit(maxsplit=3)
        try:
            x, y, z = map(float, fields)
        except ValueError:
            raise InputError(f"{path}: line {number} is not 'name x y z'") from None
        names.append(PureWindowsPath(name).name)
        vectors.append((x, y, z))
    announced = int(numbered[0][1][:9])  # more digits than any list needs
    if announced != len(vectors):
        raise InputError(f"{path}: announces {announced} lights and lists {len(vectors)}")
    return LightList(path, names, vectors, intensities=[])


def _parsed_json(path: Path, text: str) -> LightList:
    try:
        content = _JSON.validate_python(json.loads(text))
    except json.JSONDecodeError as error:
        raise InputError(f"{path}: not JSON ({error})") from error
    # ValueError: pydantic's ValidationError, or a number of thousands of digits.
    except (ValueError, RecursionError):
        raise InputError(
            f"{path}: not a list of lights; give [[x, y, z], ...] in the order of the images, or "
            '{"images": [{"file": name, "direction": [x, y, z]}, ...]}'
        ) from None
    entries = content.images if isinstance(content, _ImagesFile) else content
    names = [PureWindowsPath(e.file).name for e in entries if isinstance(e, _NamedLight)]
    vectors = [e.direction if isinstance(e, _NamedLight) else e for e in entries]
    given = [e.intensity if isinstance(e, _NamedLight) else None for e in entries]
    any_given = any(intensity is not None for intensity in given)
    intensities = [1.0 if each is None else each for each in given] if any_given else []
    return LightList(path, names, vectors, intensities)
