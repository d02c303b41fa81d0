"""What all sections of ``rig.toml`` have in common."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat

__all__ = ["Degrees", "Section"]

Degrees = Annotated[FiniteFloat, Field(ge=-3600.0, le=3600.0)]


class Section(BaseModel):
    """A frozen section that refuses unknown keys, and truth values and texts as numbers."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)
