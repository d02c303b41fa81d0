"""Video for Linux: cameras, and loopback devices to write into.

`abi` holds the kernel's structures, `device` the calls, `controls` the controls.
`camera` is a camera in measurement mode, `output` a loopback device.
"""
