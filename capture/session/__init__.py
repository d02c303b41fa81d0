"""A planned lab session: plan, journal, and a runner that publishes events."""
