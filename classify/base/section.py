"""`Section`, `Record`: base classes of the contents of files."""

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, field_validator

Degrees = Annotated[FiniteFloat, Field(ge=-3600.0, le=3600.0)]


class Record(BaseModel):
    """A frozen object of a file that the program writes itself; it refuses unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class Section(Record):
    """A frozen section that refuses unknown keys, and truth values and texts as numbers."""

    model_config = ConfigDict(strict=True)

    @field_validator("*")
    @classmethod
    def _contains_no_nul(cls, value: Any) -> Any:
        if isinstance(value, str) and "\0" in value:
            raise ValueError("contains a NUL character")
        return value
