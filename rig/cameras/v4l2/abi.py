"""The part of ``linux/videodev2.h`` used here: requests, constants, structures.

The layout is that of 64-bit little-endian Linux (x86-64, arm64). Names are the kernel's, without
the prefix ``V4L2_``.
"""

from __future__ import annotations

import ctypes
from ctypes import Array, c_char, c_int32, c_int64, c_uint8, c_uint32, c_uint64
from enum import IntEnum


class BufType(IntEnum):
    """Kinds of streams."""

    VIDEO_CAPTURE = 1
    VIDEO_OUTPUT = 2


MEMORY_MMAP = 1
FIELD_NONE = 1
PRIORITY_RECORD = 3


class Cap(IntEnum):
    """Capabilities of a device or a stream."""

    VIDEO_CAPTURE = 0x0000_0001
    VIDEO_OUTPUT = 0x0000_0002
    STREAMING = 0x0400_0000
    DEVICE_CAPS = 0x8000_0000
    TIMEPERFRAME = 0x1000


FRMSIZE_TYPE_DISCRETE = 1


class BufFlag(IntEnum):
    """Flags of a buffer."""

    ERROR = 0x0000_0040
    TIMESTAMP_MASK = 0x0000_E000
    TIMESTAMP_MONOTONIC = 0x0000_2000
    TSTAMP_SRC_MASK = 0x0007_0000
    TSTAMP_SRC_SOE = 0x0001_0000


QUANTIZATION_NAMES = {0: "default", 1: "full range", 2: "limited range"}


class CtrlType(IntEnum):
    """Types of a control."""

    INTEGER = 1
    BOOLEAN = 2
    MENU = 3
    INTEGER64 = 5
    BITMASK = 8
    INTEGER_MENU = 9


class CtrlFlag(IntEnum):
    """Flags of a control."""

    DISABLED = 0x0001
    READ_ONLY = 0x0004
    INACTIVE = 0x0010
    WRITE_ONLY = 0x0040
    NEXT_CTRL = 0x8000_0000


class Cid(IntEnum):
    """Numbers of controls."""

    BRIGHTNESS = 0x0098_0900
    CONTRAST = 0x0098_0901
    BLACK_LEVEL = 0x0098_090B
    AUTO_WHITE_BALANCE = 0x0098_090C
    RED_BALANCE = 0x0098_090E
    BLUE_BALANCE = 0x0098_090F
    GAMMA = 0x0098_0910
    AUTOGAIN = 0x0098_0912
    GAIN = 0x0098_0913
    HUE_AUTO = 0x0098_0919
    WHITE_BALANCE_TEMPERATURE = 0x0098_091A
    SHARPNESS = 0x0098_091B
    BACKLIGHT_COMPENSATION = 0x0098_091C
    AUTOBRIGHTNESS = 0x0098_0920
    EXPOSURE_AUTO = 0x009A_0901
    EXPOSURE_ABSOLUTE = 0x009A_0902
    EXPOSURE_AUTO_PRIORITY = 0x009A_0903
    FOCUS_AUTO = 0x009A_090C
    AUTO_N_PRESET_WHITE_BALANCE = 0x009A_0914
    WIDE_DYNAMIC_RANGE = 0x009A_0915
    IMAGE_STABILIZATION = 0x009A_0916
    ISO_SENSITIVITY = 0x009A_0917
    ISO_SENSITIVITY_AUTO = 0x009A_0918
    ANALOGUE_GAIN = 0x009E_0903
    DIGITAL_GAIN = 0x009F_0905


EXPOSURE_MANUAL = 1


def _words(names: str) -> tuple[tuple[str, type[c_uint32]], ...]:
    """Consecutive fields of 32 bits."""
    return tuple((name, c_uint32) for name in names.split())


class Capability(ctypes.Structure):
    """``struct v4l2_capability``."""

    _fields_ = (
        ("driver", c_char * 16),
        ("card", c_char * 32),
        ("bus_info", c_char * 32),
        *_words("version capabilities device_caps"),
        ("reserved", c_uint32 * 3),
    )


class FmtDesc(ctypes.Structure):
    """``struct v4l2_fmtdesc``."""

    _fields_ = (
        *_words("index type flags"),
        ("description", c_char * 32),
        *_words("pixelformat mbus_code"),
        ("reserved", c_uint32 * 3),
    )


class FrmSizeEnum(ctypes.Structure):
    """``struct v4l2_frmsizeenum``; a discrete size is the first two words of `size`."""

    _fields_ = (
        *_words("index pixel_format type"),
        ("size", c_uint32 * 6),
        ("reserved", c_uint32 * 2),
    )


class _PixFormat(ctypes.Structure):
    """``struct v4l2_pix_format``."""

    _fields_ = _words(
        "width height pixelformat field bytesperline sizeimage colorspace priv flags ycbcr_enc "
        "quantization xfer_func"
    )


class _FormatUnion(ctypes.Union):
    # The kernel's union holds pointers too, which align it to 8 bytes.
    _fields_ = (("pix", _PixFormat), ("raw_data", c_uint8 * 200), ("aligned", c_uint64))


class Format(ctypes.Structure):
    """``struct v4l2_format``."""

    _fields_ = (("type", c_uint32), ("fmt", _FormatUnion))


class _Fract(ctypes.Structure):
    """``struct v4l2_fract``."""

    _fields_ = _words("numerator denominator")


class _CaptureParm(ctypes.Structure):
    """``struct v4l2_captureparm``; ``v4l2_outputparm`` has the same layout."""

    _fields_ = (
        *_words("capability capturemode"),
        ("timeperframe", _Fract),
        *_words("extendedmode readbuffers"),
        ("reserved", c_uint32 * 4),
    )


class _ParmUnion(ctypes.Union):
    _fields_ = (("capture", _CaptureParm), ("raw_data", c_uint8 * 200))


class StreamParm(ctypes.Structure):
    """``struct v4l2_streamparm``."""

    _fields_ = (("type", c_uint32), ("parm", _ParmUnion))


class RequestBuffers(ctypes.Structure):
    """``struct v4l2_requestbuffers``; the last word holds flags."""

    _fields_ = _words("count type memory capabilities flags")


class _TimeVal(ctypes.Structure):
    """``struct timeval``."""

    _fields_ = (("tv_sec", c_int64), ("tv_usec", c_int64))


class _MemoryUnion(ctypes.Union):
    _fields_ = (("offset", c_uint32), ("userptr", c_uint64), ("fd", c_int32))


class Buffer(ctypes.Structure):
    """``struct v4l2_buffer``."""

    _fields_ = (
        *_words("index type bytesused flags field"),
        ("timestamp", _TimeVal),
        ("timecode", c_uint32 * 4),  # struct v4l2_timecode, which is never read
        *_words("sequence memory"),
        ("m", _MemoryUnion),
        *_words("length reserved2 request_fd"),
    )


class QueryExtCtrl(ctypes.Structure):
    """``struct v4l2_query_ext_ctrl``."""

    _fields_ = (
        *_words("id type"),
        ("name", c_char * 32),
        ("minimum", c_int64),
        ("maximum", c_int64),
        ("step", c_uint64),
        ("default_value", c_int64),
        *_words("flags elem_size elems nr_of_dims"),
        ("dims", c_uint32 * 4),
        ("reserved", c_uint32 * 32),
    )


class _MenuUnion(ctypes.Union):
    _pack_ = 1
    _fields_ = (("name", c_char * 32), ("value", c_int64))


class QueryMenu(ctypes.Structure):
    """``struct v4l2_querymenu``."""

    _pack_ = 1
    _fields_ = (*_words("id index"), ("item", _MenuUnion), ("reserved", c_uint32))


class _ControlUnion(ctypes.Union):
    _pack_ = 1
    _fields_ = (("value", c_int32), ("value64", c_int64), ("pointer", c_uint64))


class ExtControl(ctypes.Structure):
    """``struct v4l2_ext_control``."""

    _pack_ = 1
    _fields_ = (*_words("id size reserved2"), ("payload", _ControlUnion))


class ExtControls(ctypes.Structure):
    """``struct v4l2_ext_controls``."""

    _fields_ = (
        *_words("which count error_idx request_fd reserved"),
        ("controls", ctypes.POINTER(ExtControl)),
    )


_WRITE = 1
_READ = 2


def _request(direction: int, number: int, payload: type[ctypes._CData]) -> int:
    """The kernel's ``_IOC`` macro: direction, size of the payload, the letter V, number."""
    return direction << 30 | ctypes.sizeof(payload) << 16 | ord("V") << 8 | number


class Vidioc(IntEnum):
    """Requests of an ioctl."""

    QUERYCAP = _request(_READ, 0, Capability)
    ENUM_FMT = _request(_READ | _WRITE, 2, FmtDesc)
    S_FMT = _request(_READ | _WRITE, 5, Format)
    REQBUFS = _request(_READ | _WRITE, 8, RequestBuffers)
    QUERYBUF = _request(_READ | _WRITE, 9, Buffer)
    QBUF = _request(_READ | _WRITE, 15, Buffer)
    DQBUF = _request(_READ | _WRITE, 17, Buffer)
    STREAMON = _request(_WRITE, 18, c_int32)
    STREAMOFF = _request(_WRITE, 19, c_int32)
    G_PARM = _request(_READ | _WRITE, 21, StreamParm)
    S_PARM = _request(_READ | _WRITE, 22, StreamParm)
    QUERYMENU = _request(_READ | _WRITE, 37, QueryMenu)
    S_PRIORITY = _request(_WRITE, 68, c_uint32)
    G_EXT_CTRLS = _request(_READ | _WRITE, 71, ExtControls)
    S_EXT_CTRLS = _request(_READ | _WRITE, 72, ExtControls)
    ENUM_FRAMESIZES = _request(_READ | _WRITE, 74, FrmSizeEnum)
    QUERY_EXT_CTRL = _request(_READ | _WRITE, 103, QueryExtCtrl)


def fourcc(text: str) -> int:
    """The number of a four-character code such as ``"GREY"`` or ``"Y10 "``."""
    return int.from_bytes(text.encode("ascii"), "little")


def fourcc_text(number: int) -> str:
    """The four characters of a code, with dots for unprintable ones."""
    characters = number.to_bytes(4, "little").decode("latin-1")
    return "".join(c if " " <= c <= "~" else "." for c in characters)


def text(field: Array[c_char] | bytes) -> str:
    """The text of a C string."""
    return bytes(field).split(b"\0")[0].decode("utf-8", "replace")
