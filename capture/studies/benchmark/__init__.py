"""What this machine makes of the engine: ratios to a floor measured in the same run, and times."""
