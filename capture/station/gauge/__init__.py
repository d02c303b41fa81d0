"""Gauge studies: known parts presented again and again."""
