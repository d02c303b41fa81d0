"""Gauge studies: known parts, each presented several times."""
