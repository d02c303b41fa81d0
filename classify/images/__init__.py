"""Images as they are given, display colours, and image noise."""
