"""Poll stdin and stdout: whether the host has sent bytes, and whether it takes more."""

import host
import machine

POLLIN = 1
POLLOUT = 4


class poll:
    def register(self, stream, flags):
        self.flags = flags

    def poll(self, timeout_ms):
        assert timeout_ms == 0
        machine.run_hardware()
        return [self] if (host.writable() if self.flags == POLLOUT else host.readable()) else []
