"""The state and the events of a running station, for all its interfaces."""
