"""Configuration, recipes, verdicts, users and files of a station."""
