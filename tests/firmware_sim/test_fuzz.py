"""Random bytes in random pieces: one reply per line, and only valid commands act."""

import re
from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

COMMANDS = [
    *[b"*IDN?", b"*RST", b"SYST:ERR?", b"SYST:WDOG 250", b"SYST:WDOG?", b"LED:SEL 1", b"LED:OFF"],
    *[b"LED:LEV 1,40", b"LED:LEV? 2", b"LED:STAT?", b"#7 LED:SEL 2", b"#7 LED:SEL 2~E0", b""],
    *[b"SEQ:ARM 2000,9000,-1,0,3", b"SEQ:TRIG 2000,9000,3", b"SEQ:STAT?", b"SEQ:STEP? 0"],
    b"LED:LIM? 1",
]

# Grammar of the lines without checksum that may be accepted, independent of the parser.
ACCEPTABLE = re.compile(
    rb" *(#0*\d{1,5} +)?"
    rb"(\*IDN\?|\*RST|SYST:ERR\?|SYST:WDOG +\d+|SYST:WDOG\?|LED:SEL +0*[0-3]|LED:OFF"
    rb"|LED:LEV +0*[0-3] *, *\d+|LED:LEV\? +0*[0-3]|LED:STAT\?|LED:LIM\? +0*[0-3]"
    rb"|SEQ:(ARM|TRIG) +\d+ *, *\d+( *, *(-1|0*[0-3])){1,16}|SEQ:STAT\?|SEQ:STEP\? +\d+) *\r?",
    re.IGNORECASE,
)


@st.composite
def damaged_command(draw: st.DrawFn) -> bytes:
    line = bytearray(draw(st.sampled_from(COMMANDS)))
    for _ in range(draw(st.integers(0, 2))):
        place = draw(st.integers(0, len(line)))
        line[place : place + draw(st.integers(0, 2))] = draw(st.binary(max_size=2))
    return bytes(line)


LINES = st.lists(damaged_command() | st.binary(max_size=80), max_size=8)


@given(lines=LINES, cuts=st.lists(st.integers(0, 700), max_size=12))
def test_a_line_in_any_pieces_gets_one_reply(new_device, lines, cuts):
    data = b"\n".join(lines)
    whole, cut = new_device(), new_device()
    expected = whole.exchange(data)
    places = [0, *sorted(cuts), len(data)]
    pieces = [data[a:b] for a, b in pairwise(places)]
    assert b"".join(cut.exchange(piece) for piece in pieces) == expected
    replies = expected.split(b"\n")[:-1]
    assert len(replies) == data.count(b"\n")
    assert all(re.fullmatch(rb"(#\d+ )?(OK|ERR -?\d+)[ -}]*(~[0-9A-F]{2})?", r) for r in replies)


@given(lines=LINES)
def test_a_refused_line_changes_nothing(new_device, lines):
    device = new_device()
    device.exchange(b"LED:LEV 3,30\nLED:SEL 3\n")
    for line in b"\n".join(lines).split(b"\n"):
        before = state(device)
        reply = device.exchange(line + b"\n")
        if b"ERR" in reply:
            assert state(device) == before
        elif b"~" not in line:
            assert ACCEPTABLE.fullmatch(line)
        device.exchange(b"LED:OFF\n")  # a sequence would continue by itself


def state(device) -> tuple[bytes, bytes, list[float]]:
    selected_and_levels, _, _ = device.exchange(b"LED:STAT?\n").rpartition(b",")
    return selected_and_levels, device.exchange(b"SYST:WDOG?\n"), device.lit()
