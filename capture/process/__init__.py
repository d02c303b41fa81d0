"""The process of the command line: signals, streams, crash logs, the lock on a folder, UTC."""
