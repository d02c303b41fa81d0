"""The part of ``linux/videodev2.h`` used here: requests, constants, structures.

The layout is that of 64-bit little-endian Linux (x86-64, arm64). Names are the kernel's, without
the prefix ``V4L2_``.
"""

from __future__ import annotations

import ctypes
from ctypes import (
    Array,
    c_char,
    c_int32,
    c_int64,
    c_uint8,
    c_uint32,
    c_uint64,
)

BUF_TYPE_VIDEO_CAPTURE = 1
BUF_TYPE_VIDEO_OUTPUT = 2
MEMORY_MMAP = 1
FIELD_NONE = 1
PRIORITY_RECORD = 3

CAP_VIDEO_CAPTURE = 0x0000_0001
CAP_VIDEO_OUTPUT = 0x0000_0002
CAP_STREAMING = 0x0400_0000
CAP_DEVICE_CAPS = 0x8000_0000
CAP_TIMEPERFRAME = 0x1000

FRMSIZE_TYPE_DISCRETE = 1

BUF_FLAG_ERROR = 0x0000_0040
BUF_FLAG_TIMESTAMP_MASK = 0x0000_E000
BUF_FLAG_TIMESTAMP_MONOTONIC = 0x0000_2000
BUF_FLAG_TSTAMP_SRC_MASK = 0x0007_0000
BUF_FLAG_TSTAMP_SRC_SOE = 0x0001_0000

QUANTIZATION_NAMES = {0: "default", 1: "full range", 2: "limited range"}

CTRL_TYPE_INTEGER = 1
CTRL_TYPE_BOOLEAN = 2
CTRL_TYPE_MENU = 3
CTRL_TYPE_INTEGER64 = 5
CTRL_TYPE_BITMASK = 8
CTRL_TYPE_INTEGER_MENU = 9

CTRL_FLAG_DISABLED = 0x0001
CTRL_FLAG_READ_ONLY = 0x0004
CTRL_FLAG_INACTIVE = 0x0010
CTRL_FLAG_WRITE_ONLY = 0x0040
CTRL_FLAG_NEXT_CTRL = 0x8000_0000

CID_BRIGHTNESS = 0x0098_0900
CID_CONTRAST = 0x0098_0901
CID_BLACK_LEVEL = 0x0098_090B
CID_AUTO_WHITE_BALANCE = 0x0098_090C
CID_RED_BALANCE = 0x0098_090E
CID_BLUE_BALANCE = 0x0098_090F
CID_GAMMA = 0x0098_0910
CID_AUTOGAIN = 0x0098_0912
CID_GAIN = 0x0098_0913
CID_HUE_AUTO = 0x0098_0919
CID_WHITE_BALANCE_TEMPERATURE = 0x0098_091A
CID_SHARPNESS = 0x0098_091B
CID_BACKLIGHT_COMPENSATION = 0x0098_091C
CID_AUTOBRIGHTNESS = 0x0098_0920
CID_EXPOSURE_AUTO = 0x009A_0901
CID_EXPOSURE_ABSOLUTE = 0x009A_0902
CID_EXPOSURE_AUTO_PRIORITY = 0x009A_0903
CID_FOCUS_AUTO = 0x009A_090C
CID_AUTO_N_PRESET_WHITE_BALANCE = 0x009A_0914
CID_WIDE_DYNAMIC_RANGE = 0x009A_0915
CID_IMAGE_STABILIZATION = 0x009A_0916
CID_ISO_SENSITIVITY = 0x009A_0917
CID_ISO_SENSITIVITY_AUTO = 0x009A_0918
CID_ANALOGUE_GAIN = 0x009E_0903
CID_DIGITAL_GAIN = 0x009F_0905
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


class QueryCtrl(ctypes.Structure):
    """``struct v4l2_queryctrl``, for drivers older than `QueryExtCtrl`."""

    _fields_ = (
        *_words("id type"),
        ("name", c_char * 32),
        ("minimum", c_int32),
        ("maximum", c_int32),
        ("step", c_int32),
        ("default_value", c_int32),
        *_words("flags reserved0 reserved1"),
    )


class SimpleControl(ctypes.Structure):
    """``struct v4l2_control``."""

    _fields_ = (("id", c_uint32), ("value", c_int32))


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


VIDIOC_QUERYCAP = _request(_READ, 0, Capability)
VIDIOC_ENUM_FMT = _request(_READ | _WRITE, 2, FmtDesc)
VIDIOC_S_FMT = _request(_READ | _WRITE, 5, Format)
VIDIOC_REQBUFS = _request(_READ | _WRITE, 8, RequestBuffers)
VIDIOC_QUERYBUF = _request(_READ | _WRITE, 9, Buffer)
VIDIOC_QBUF = _request(_READ | _WRITE, 15, Buffer)
VIDIOC_DQBUF = _request(_READ | _WRITE, 17, Buffer)
VIDIOC_STREAMON = _request(_WRITE, 18, c_int32)
VIDIOC_STREAMOFF = _request(_WRITE, 19, c_int32)
VIDIOC_G_PARM = _request(_READ | _WRITE, 21, StreamParm)
VIDIOC_S_PARM = _request(_READ | _WRITE, 22, StreamParm)
VIDIOC_G_CTRL = _request(_READ | _WRITE, 27, SimpleControl)
VIDIOC_S_CTRL = _request(_READ | _WRITE, 28, SimpleControl)
VIDIOC_QUERYCTRL = _request(_READ | _WRITE, 36, QueryCtrl)
VIDIOC_QUERYMENU = _request(_READ | _WRITE, 37, QueryMenu)
VIDIOC_S_PRIORITY = _request(_WRITE, 68, c_uint32)
VIDIOC_G_EXT_CTRLS = _request(_READ | _WRITE, 71, ExtControls)
VIDIOC_S_EXT_CTRLS = _request(_READ | _WRITE, 72, ExtControls)
VIDIOC_ENUM_FRAMESIZES = _request(_READ | _WRITE, 74, FrmSizeEnum)
VIDIOC_QUERY_EXT_CTRL = _request(_READ | _WRITE, 103, QueryExtCtrl)


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
