"""Defects of a part: where its relief, albedo or texture departs from good parts."""
