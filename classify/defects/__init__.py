"""Defects of a part: where its relief, albedo or texture departs from those of good parts."""
