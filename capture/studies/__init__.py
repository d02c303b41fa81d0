"""What ps4rig says about itself: the chapter reproduced, benchmarks, and the demonstration."""
