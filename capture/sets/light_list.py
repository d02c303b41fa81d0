"""Light directions of photographs, from an RTI ``.lp`` file or JSON."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path, PureWindowsPath

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, TypeAdapter

from classify import Lighting
from classify.errors import InputError
from classify.regular_file import read_regular_file

__all__ = ["LightList", "load_light_list"]

_MAX_BYTES = 4 * 2**20
_MAX_LIGHTS = 255  # of a captured set with an ambient image
Vector = tuple[FiniteFloat, FiniteFloat, FiniteFloat]


class _NamedLight(BaseModel):
    model_config = ConfigDict(frozen=True, extra="ignore")
    file: str
    direction: Vector
    intensity: float = Field(default=1.0, gt=0.0, allow_inf_nan=False)


class _ImagesFile(BaseModel):
    model_config = ConfigDict(frozen=True, extra="ignore")
    images: tuple[_NamedLight, ...]


_JSON: TypeAdapter[_ImagesFile | tuple[_NamedLight, ...] | tuple[Vector, ...]] = TypeAdapter(
    _ImagesFile | tuple[_NamedLight, ...] | tuple[Vector, ...]
)


class LightList:
    """Light directions of a file, by image name or in order.

    Parameters
    ----------
    source
        The file, for messages and to find the images it names.
    names
        Image names without folder, one per vector, or None if the vectors are in order.
    vectors
        (x, y, z) towards each light; x right, y up, z to the camera.
    intensities
        Relative intensity of each light; all 1 if None.
    """

    def __init__(
        self,
        source: Path,
        names: Sequence[str] | None,
        vectors: Sequence[Vector],
        intensities: Sequence[float] | None = None,
    ) -> None:
        if not 1 <= len(vectors) <= _MAX_LIGHTS:
            raise InputError(
                f"{source}: lists {len(vectors)} lights; 1 to {_MAX_LIGHTS} are handled"
            )
        if names is not None and len(set(names)) != len(names):
            twice = next(name for name in names if list(names).count(name) > 1)
            raise InputError(f"{source}: names image {twice} twice")
        self.source = source
        self._names = names
        self._vectors = vectors
        self._intensities = intensities or [1.0] * len(vectors)

    @property
    def named_paths(self) -> list[Path]:
        """The images that the file names, in its own folder; empty if it gives no names."""
        return [self.source.parent / name for name in self._names or ()]

    def image_paths(self) -> list[Path]:
        """Return `named_paths`.

        Raises
        ------
        InputError
            If the file gives no names.
        """
        if self._names is None:
            raise InputError(f"{self.source}: gives no image names; name the images themselves")
        return self.named_paths

    def lighting_for(self, images: Sequence[Path]) -> Lighting:
        """Return the lights of these images, by name, or in order if the file has no names.

        Raises
        ------
        InputError
            If an image is not listed, or the counts differ.
        """
        if self._names is None:
            if len(images) != len(self._vectors):
                raise InputError(
                    f"{self.source}: {len(self._vectors)} lights for {len(images)} images; "
                    "give one each, in the same order"
                )
            return self._lighting(range(len(images)))
        index_of = {name: index for index, name in enumerate(self._names)}
        missing = [image.name for image in images if image.name not in index_of]
        if missing:
            raise InputError(f"{self.source}: lists no light for {missing[0]}")
        return self._lighting([index_of[image.name] for image in images])

    def _lighting(self, chosen: Sequence[int]) -> Lighting:
        try:
            return Lighting(
                np.array([self._vectors[index] for index in chosen]),
                np.array([self._intensities[index] for index in chosen]),
            )
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
    return LightList(path, names, vectors)


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
    intensities = [e.intensity if isinstance(e, _NamedLight) else 1.0 for e in entries]
    return LightList(path, names or None, vectors, intensities)
