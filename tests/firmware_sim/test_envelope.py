"""Sequence ids and checksums, compared with an independent implementation."""

from hypothesis import given
from hypothesis import strategies as st

from firmware_sim import crc8


def crc8_by_division(data: bytes) -> int:
    """Remainder of data * x^8 divided by x^8 + x^2 + x + 1, by polynomial division."""
    value = int.from_bytes(data, "big") << 8
    while value.bit_length() > 8:
        value ^= 0x107 << (value.bit_length() - 9)
    return value


def sealed(message: bytes) -> bytes:
    return b"%s~%02X" % (message, crc8_by_division(message))


@given(st.binary(max_size=64))
def test_crc8_is_polynomial_division(data):
    assert crc8(data) == crc8_by_division(data)


@given(sequence=st.integers(0, 65535), led=st.integers(0, 3))
def test_a_line_with_checksum_gets_a_reply_with_checksum(new_device, sequence, led):
    device = new_device()
    reply = device.exchange(sealed(b"#%d LED:SEL %d" % (sequence, led)) + b"\n")
    assert reply == sealed(b"#%d OK %d,1000" % (sequence, led)) + b"\n"


@given(damage=st.integers(1, 255), place=st.integers(0, len(b"#12 LED:SEL 2") - 1))
def test_a_damaged_byte_never_switches(new_device, damage, place):
    message = bytearray(b"#12 LED:SEL 2")
    seal = sealed(message)[-3:]
    message[place] ^= damage
    device = new_device()
    reply = device.exchange(bytes(message) + seal + b"\n")
    # A damaged byte may become a line end; then neither part may be executed.
    assert b"OK" not in reply
    assert reply.endswith(sealed(b'ERR -360,"Communication error"') + b"\n")
    assert device.lit() == [0.0] * 4


def test_a_checksum_may_have_lower_case_and_blanks_around_it(device):
    # The checksum covers the blanks before it, not those after it.
    assert device.exchange(sealed(b" LED:OFF ") + b"  \r\n") == sealed(b"OK -1,1000") + b"\n"
    assert device.exchange(b"#7 LED:SEL 2~e0\n") == sealed(b"#7 OK 2,2000") + b"\n"


def test_half_a_checksum_is_a_wrong_checksum(device):
    bad = sealed(b'ERR -360,"Communication error"') + b"\n"
    for line in (
        b"LED:SEL 1~",
        b"LED:SEL 1~6",
        b"LED:SEL 1~XX",
        b"LED:SEL 1~062",
        b"~",
        b"LED~SEL",
    ):
        assert device.exchange(line + b"\n") == bad
    assert device.lit() == [0.0] * 4


def test_errors_of_lines_with_checksum_have_a_checksum(device):
    assert device.exchange(sealed(b"#9 HELLO") + b"\n") == (
        sealed(b'#9 ERR -113,"Undefined header"') + b"\n"
    )
    assert device.exchange(sealed(b"") + b"\n") == sealed(b'ERR -102,"Syntax error"') + b"\n"
