"""Measure latencies: from a command to its acknowledge, from a switch to the frames."""
