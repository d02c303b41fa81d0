"""Only there on an RP2040 or RP2350."""
