"""Images as they are given, and how noisy they are."""
