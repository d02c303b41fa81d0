"""Studies of ps4rig itself: reproduction of the thesis's chapter, benchmarks, and the demo."""
