"""Captured sets that must get their verdict before a changed recipe runs."""
