"""The base class of all sections of ``rig.toml``."""

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, field_validator

Degrees = Annotated[FiniteFloat, Field(ge=-3600.0, le=3600.0)]


class Section(BaseModel):
    """A frozen section that refuses unknown keys, and truth values and texts as numbers."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    @field_validator("*")
    @classmethod
    def _contains_no_nul(cls, value: Any) -> Any:
        if isinstance(value, str) and "\0" in value:
            raise ValueError("contains a NUL character")
        return value
