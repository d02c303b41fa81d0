"""A planned lab session: plan, journal, runner. Events say what happens; who listens is unknown."""
