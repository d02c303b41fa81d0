"""Studies of the product: commands that print a table beside its limits."""

import os

# As in the program: on a busy machine, threads of BLAS wait for each other several times as long as
# a product of small matrices takes. BLAS, also that of workers, reads this when it is loaded.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
