"""What in the network of this machine loses packets of a GigE Vision camera."""

from collections.abc import Iterator
from pathlib import Path

from rig.cameras.camera import CameraInfo
from rig.errors import ControlFault

from .pixel_formats import PIXEL_FORMATS

LARGEST_BUFFER = Path("/proc/sys/net/core/rmem_max")
# A frame arrives faster than it is read while another program has the processor.
_FRAMES_IN_BUFFER = 2
# Of gigabit Ethernet, less the headers of its packets.
_MOST_MB_PER_S = 115.0
# With packets of 1,500 bytes the kernel handles this many a second without losses on two cores.
_MOST_PACKETS_PER_S = 40_000


def network_faults(info: CameraInfo) -> Iterator[ControlFault]:
    """Rate, packets and buffers that do not suffice for the frames of an open camera."""
    record = info.controls["genicam"]
    if "packet_bytes" not in record:
        return  # not in a network
    bits = PIXEL_FORMATS[record["pixel_format"]].bits_in_memory
    frame_bytes = info.width_px * info.height_px * bits // 8
    rate_mb_per_s = frame_bytes / info.frame_period_s / 1e6
    if rate_mb_per_s > _MOST_MB_PER_S:
        yield ControlFault(
            "network rate",
            f"frames of {frame_bytes / 1e6:.1f} MB at {1.0 / info.frame_period_s:g} Hz are "
            f"{rate_mb_per_s:.0f} MB/s, gigabit Ethernet carries {_MOST_MB_PER_S:.0f}",
            "lower camera.frame_rate_hz, or choose a packed camera.pixel_format",
        )
    packet_bytes = record["packet_bytes"]
    packets_per_s = 1e6 * rate_mb_per_s / packet_bytes
    if packets_per_s > _MOST_PACKETS_PER_S:
        yield ControlFault(
            "packet size",
            f"{packets_per_s:.0f} packets of {packet_bytes} bytes a second",
            "allow large packets: sudo ip link set IFACE mtu 9000",
        )
    wanted_bytes = _FRAMES_IN_BUFFER * frame_bytes
    try:
        largest_bytes = int(LARGEST_BUFFER.read_text())
    except (OSError, ValueError):
        return  # not Linux
    if largest_bytes < wanted_bytes:
        yield ControlFault(
            "socket buffer",
            f"a socket may hold {largest_bytes} bytes, {_FRAMES_IN_BUFFER} frames are "
            f"{wanted_bytes}",
            f"sudo sysctl -w net.core.rmem_max={wanted_bytes}",
        )
