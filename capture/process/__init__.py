"""The process of the command line: signals, standard streams and crash logs."""
