"""palpate beside a Gaussian process that explores by greatest variance.

The peer lives in the checkout's ``benchmarks``, for palpate does not need it: it is run as a
program of its own.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

from palpate.launch.bench_row import Row

PEER = Path(__file__).resolve().parent.parent / "benchmarks" / "gp_peer.py"


def peer_rows(quick: bool) -> Iterable[Row]:
    """Figures of the peer, as it prints them.

    Parameters
    ----------
    quick : bool
        Fewer objects.
    """
    if not PEER.is_file():
        yield Row("peer", "not here", "a checkout with benchmarks/", False)
        return
    command = [sys.executable, str(PEER), *(["--quick"] if quick else [])]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as running:
        assert running.stdout is not None
        for line in running.stdout:
            yield Row(**json.loads(line))
    if running.returncode:
        yield Row("peer", f"ended with {running.returncode}", "0", False)
