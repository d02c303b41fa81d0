"""What every storey stands on: console, signals, streams, locks, times, pages, outputs."""
