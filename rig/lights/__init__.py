"""The light controller: found, opened, told what to light, watched, flashed.

`driver` has the commands, `link` one open line below it, `serial_line` and `wire` the bytes.
Whether a board or a simulated one answers is not known here.
"""
