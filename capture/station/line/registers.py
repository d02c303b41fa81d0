"""The table of Modbus registers, from which codecs and the reference are made."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntFlag
from typing import Any, Literal, Self

from capture.station.domain.verdict import Decision
from capture.station.results.part_result import PartResult
from capture.station.run.events import State

PAGE_VERSION = 3  # 3 has orientation_period
_NO_ORIENTATION = 0xFFFF
# Ids given with a trigger have up to 100 characters, two in a word.
_ID_WORDS = 50
# A read takes up to 125 registers, a write up to 123.
PLC_ADDRESS = 100

_Type = Literal["u16", "u32", "bits", "text"]
_Values = Mapping[str, Any]


class Bit(IntFlag):
    """A bit of a register with its meaning for the reference; a combination of bits has none."""

    meaning: str

    def __new__(cls, value: int, meaning: str = "") -> Self:
        """Create a bit of that value, with its meaning."""
        bit = int.__new__(cls, value)
        bit._value_, bit.meaning = value, meaning
        return bit


class Status(Bit):
    """Bits of ``status``, which the station sets."""

    READY = 1, "Trigger may be set"
    ACK = 2, "the trigger `trigger_id` was accepted as part `number`; until Trigger falls"
    EXPOSURE_COMPLETE = 4, "part `number` is not exposed any more: it may move"
    BUSY = 8, "a trigger has no answer, or a part has no result"
    RESULTS_VALID = 16, "a result is shown; its registers do not change"
    REFUSED = 32, "the trigger `trigger_id` was refused because of `error`; until Trigger falls"
    WRONG_ACK = 64, "`ack_number` was not `result_number`; until ResultsAck falls"
    SIMULATED = 128, "the rig is simulated: results are not of real parts"
    RECIPE_LOADED = 256, "the recipe `selected` is loaded; until SelectRecipe falls"
    RECIPE_REFUSED = (
        512,
        "the recipe `selected` is not loaded because of `select_error`; until SelectRecipe falls",
    )


class Command(Bit):
    """Bits of ``commands``, which the PLC sets."""

    TRIGGER = 1, "its rise says that a part lies below the camera"
    RESULTS_ACK = 2, "its rise acknowledges the result `ack_number`"
    SELECT_RECIPE = 4, "its rise asks the station to load the recipe `recipe`"


VERDICTS = {
    Decision.PASS: 1,
    Decision.FAIL: 2,
    Decision.UNKNOWN: 3,
    Decision.ERROR: 4,
}
STATES = {
    State.PREOPERATIONAL: 0,
    State.INITIALIZED: 1,
    State.READY: 2,
    State.EXECUTING: 3,
    State.ERROR: 4,
}


@dataclass(frozen=True)
class Register:
    """One value of the page."""

    address: int  # first register, from 0
    name: str
    # ``u32``: high word first; ``text``: ASCII, first character in the high byte, zero-filled.
    type: _Type
    words: int  # number of registers
    meaning: str  # for the reference


def _page(first: int, *rows: tuple[str, _Type, str]) -> tuple[Register, ...]:
    registers = []
    words_of: dict[_Type, int] = {"u16": 1, "u32": 2, "bits": 1, "text": _ID_WORDS}
    for name, kind, meaning in rows:
        registers.append(Register(first, name, kind, words_of[kind], meaning))
        first += words_of[kind]
    return tuple(registers)


STATION = _page(
    0,
    ("page", "u16", f"version of this page: {PAGE_VERSION}"),
    ("session", "u32", "another number after each start of the station, never 0"),
    ("heartbeat", "u16", "counts up twice a second"),
    ("status", "bits", "see below"),
    ("state", "u16", "see below"),
    ("error", "u16", "why the trigger was refused, see below; 0 unless Refused is set"),
    ("trigger_id", "u16", "id of the last trigger; Ack and Refused are the answer to this one"),
    ("number", "u32", "number of the part that was accepted last"),
    ("recipe", "u16", "position of the loaded recipe in `recipes`, from 1; 0 if it is not there"),
    ("recipe_version", "u16", "its version"),
    ("recipe_hash", "u32", "first 8 hexadecimal digits of its SHA-256"),
    ("result_number", "u32", "number of the part whose result is shown; 0 without ResultsValid"),
    ("verdict", "u16", "see below; 0 without ResultsValid"),
    ("cause", "u16", "gravest cause, see below; 0 for PASS"),
    (
        "orientation",
        "u16",
        f"tenths of a degree below the period; {_NO_ORIENTATION}: not measured",
    ),
    ("result_hash", "u32", "as recipe_hash, of the recipe that judged the part; 0: none"),
    ("overruns", "u16", "results that were dropped because the PLC did not acknowledge"),
    ("result_part_id", "text", "id of the part"),
    ("selected", "u16", "`recipe` of the last rise of SelectRecipe, which the answer is to"),
    (
        "select_error",
        "u16",
        "why the recipe was not loaded, see below; 0 unless RecipeRefused is set",
    ),
    (
        "orientation_period",
        "u16",
        "degrees: 360 with `full_turn`, if the texture shows it, else 180; 0: not measured",
    ),
)
PLC = _page(
    PLC_ADDRESS,
    ("heartbeat", "u16", "any number, another one at least each 2 s; 0: no heartbeat"),
    ("commands", "bits", "see below"),
    ("trigger_id", "u16", "another number than that of the last trigger, and not 0"),
    ("ack_number", "u32", "result_number of the result that is acknowledged"),
    ("recipe", "u16", "required recipe: its position in `recipes`; 0: whichever is loaded"),
    ("part_id", "text", "id of the part; empty: the station makes one"),
)
STATION_WORDS = STATION[-1].address + STATION[-1].words
PLC_WORDS = PLC[-1].address + PLC[-1].words - PLC_ADDRESS


def registers_of(part: PartResult | None) -> _Values:
    """Return the values of the registers for a result, or for no result."""
    if part is None:
        names = "result_number", "verdict", "cause", "result_hash", "orientation_period"
        return dict.fromkeys(names, 0) | {"orientation": _NO_ORIENTATION, "result_part_id": ""}
    verdict = part.verdict
    angle_deg, period_deg = part.orientation_deg or 0.0, round(part.orientation_period_deg or 0.0)
    return {
        "result_number": part.number,
        "verdict": VERDICTS[verdict.decision],
        "cause": verdict.causes[0].plc_code if verdict.causes else 0,
        "orientation": round(10 * angle_deg) % (10 * period_deg) if period_deg else _NO_ORIENTATION,
        "orientation_period": period_deg,
        "result_hash": first_digits(part.recipe_sha256),
        "result_part_id": part.part_id,
    }


def first_digits(sha256: str | None) -> int:
    """Return the first 8 hexadecimal digits of a hash as a number; 0 without a hash."""
    return 0 if sha256 is None else int(sha256[:8], 16)


def encoded(registers: Sequence[Register], values: _Values) -> list[int]:
    """Return the words of a page; numbers modulo their width, text cut to fit."""
    words: list[int] = []
    for register in registers:
        value = values[register.name]
        if register.type == "text":
            data = value.encode("ascii", "replace")[: 2 * register.words].ljust(
                2 * register.words, b"\0"
            )
            words += [data[i] << 8 | data[i + 1] for i in range(0, len(data), 2)]
        elif register.type == "u32":
            words += [value >> 16 & 0xFFFF, value & 0xFFFF]
        else:
            words.append(value & 0xFFFF)
    return words


def decoded(registers: Sequence[Register], words: Sequence[int]) -> dict[str, Any]:
    """Return the values of a page, by name."""
    values: dict[str, Any] = {}
    first = registers[0].address
    for register in registers:
        value = words[register.address - first :][: register.words]
        if register.type == "text":
            data = b"".join(word.to_bytes(2, "big") for word in value)
            values[register.name] = data.decode("ascii", "replace").rstrip("\0 ")
        else:
            is_double = register.type == "u32"
            values[register.name] = value[0] << 16 | value[1] if is_double else value[0]
    return values
