"""`Taught`: measurements on the taught parts of a recipe, as a JSON file."""

from collections.abc import Mapping
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, FiniteFloat

from capture.base.names import Label, Name
from capture.calibration.setting import Setting
from capture.station.domain.errors import RecipeError
from classify.base.errors import InputError
from classify.base.models import Record
from rig.set_file import fields_sha256

from .least_found import LeastFound
from .recipe import Region, Sha256

# 10,000 parts with their hashes take 2 MB.
_MAX_BYTES = 1 << 24


class TaughtSet(Record):
    """A taught captured set: its file in the folder ``sets``, the hash of its pixels."""

    file: Name
    pixels_sha256: Sha256
    # Match with a library of all other sets; None for an unknown texture.
    found: Label | None = None
    nearest: Label | None = None
    distance: FiniteFloat | None = None


class TaughtTexture(Record):
    """Measurements on the taught parts of one texture."""

    sets: tuple[TaughtSet, ...] = Field(min_length=1)  # in the order they were given
    # Mean of each light over all parts, as a share of full scale.
    light_signals: tuple[Annotated[float, Field(gt=0.0, le=1.0)], ...]
    defects_file: Name | None = None  # None, like the next three, for a texture that does not pass
    defects_sha256: Sha256 | None = None
    pieces_file: Name | None = None
    pieces_sha256: Sha256 | None = None
    # By the defect map, at the limits that were taught; empty for a texture that does not pass.
    least_found: tuple[LeastFound, ...] = ()


class Taught(Record):
    """The measurements of teaching on all parts of a recipe."""

    format: Literal["ps4rig-taught"] = "ps4rig-taught"
    version: Literal[3] = 3
    utc: str = Field(default_factory=lambda: datetime.now(UTC).isoformat(timespec="seconds"))
    software_version: str = Field(default_factory=lambda: version("ps4rig"))
    setting: Setting  # of the rig; a set with another setting cannot be judged
    region: Region | None = None  # of the recipe, within which everything was measured
    has_calibration: bool
    library_sha256: Sha256
    textures: Mapping[Label, TaughtTexture] = Field(min_length=1)

    @property
    def least_found(self) -> dict[str, tuple[LeastFound, ...]]:
        """How strong defects must be to be found, for each texture that passes."""
        return {
            name: texture.least_found
            for name, texture in self.textures.items()
            if texture.least_found
        }

    @property
    def least_found_fields(self) -> list[dict[str, Any]]:
        """The same as fields of JSON."""
        return [
            {"texture": name} | least_found.fields()
            for name, found in self.least_found.items()
            for least_found in found
        ]

    @property
    def sha256(self) -> str:
        """Hash of all fields, which the recipe names."""
        return fields_sha256(self.model_dump(mode="json"))


def read_taught(path: Path) -> Taught:
    """Read the measurements of teaching."""
    try:
        return Taught.read(path, _MAX_BYTES, "run ps4rig station teach")
    except InputError as error:
        raise RecipeError(str(error)) from error
