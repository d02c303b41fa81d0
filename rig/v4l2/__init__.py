"""Video for Linux: cameras as drivers give them, and loopback devices to write into.

`abi` and `ioctl` are the kernel's words, `device` and `controls` what can be asked of any video
device, `camera` is one that is set for measurement, `output` the other side of a loopback device.
"""
