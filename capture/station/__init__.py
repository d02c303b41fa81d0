"""The inspection station: trigger, captured set, match, verdict, record."""
