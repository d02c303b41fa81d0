"""Process of the command line: signals, streams, crash logs, folder locks, UTC."""
