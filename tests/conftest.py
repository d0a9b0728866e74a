"""What all tests share. The helper modules beside this file are imported by name."""

from __future__ import annotations

import os

# one thread for each test process, whatever the machine: set before numpy is imported
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
