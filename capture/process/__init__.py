"""The process of the command line: signals, standard streams, crash logs, threads and memory."""
