"""What holds for all tests."""

from __future__ import annotations

import os

# Before numpy is imported: with several threads BLAS rounds differently from run to run, and
# bodies are compared to the last bit. Nodes run with one thread each as well.
for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[name] = "1"
