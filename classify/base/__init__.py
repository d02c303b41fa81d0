"""What every room stands on: errors, durable files, archives, threads, kernels, labels."""
