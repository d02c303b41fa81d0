"""What all sections of ``rig.toml`` have in common."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat

__all__ = ["Degrees", "Section"]

Degrees = Annotated[FiniteFloat, Field(ge=-3600.0, le=3600.0)]


class Section(BaseModel):
    """Values that cannot be changed; a key that is not known is refused."""

    model_config = ConfigDict(frozen=True, extra="forbid")
