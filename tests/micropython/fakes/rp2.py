"""A module that exists only on an RP2040 or RP2350."""
