"""Registers of the PLC, their bits and codes, as Markdown."""

from collections.abc import Iterable, Mapping

from capture.station.domain.verdict import Cause
from capture.station.line.registers import (
    PLC,
    STATES,
    STATION,
    VERDICTS,
    Bit,
    Command,
    Register,
    Status,
)
from capture.station.run.triggers import RecipeRefusal, Refusal


def register_lines() -> list[str]:
    """Return the registers of both sides, and what their bits and codes mean."""
    return [
        *_registers("Written by the station", STATION),
        *_registers("Written by the PLC", PLC),
        *_bits("status", Status),
        *_bits("commands", Command),
        *_codes("error", {code: code.meaning for code in Refusal}),
        *_codes("select_error", {code: code.meaning for code in RecipeRefusal}),
        *_codes("verdict", {code: str(word) for word, code in VERDICTS.items()}),
        *_codes("state", {code: str(word) for word, code in STATES.items()}),
    ]


def cause_lines() -> list[str]:
    """Return a line for each cause: the code for a PLC, the name, the verdict, the meaning."""
    return [f"- {row.plc_code} `{row}` {row.decision}: {row.meaning}" for row in Cause]


def _registers(title: str, registers: Iterable[Register]) -> list[str]:
    lines = [f"- {_range(each)} `{each.name}` {each.type}: {each.meaning}" for each in registers]
    return ["", f"{title}:", "", *lines]


def _range(register: Register) -> str:
    first, last = register.address, register.address + register.words - 1
    return f"{first}" if first == last else f"{first}-{last}"


def _bits(name: str, bits: Iterable[Bit]) -> list[str]:
    numbered = {
        bit.value.bit_length() - 1: f"{_camel_case(str(bit.name))}: {bit.meaning}" for bit in bits
    }
    return _codes(name, numbered, "Bits")


def _camel_case(name: str) -> str:
    return "".join(word.capitalize() for word in name.split("_"))


def _codes(name: str, meanings: Mapping[int, str], kind: str = "Codes") -> list[str]:
    lines = [f"- {code:d} {meaning}" for code, meaning in meanings.items()]
    return ["", f"{kind} of `{name}`:", "", *lines]
