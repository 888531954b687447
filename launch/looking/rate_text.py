"""Rates, bandwidths and delays as `ros2` prints them."""

from __future__ import annotations

from collections.abc import Callable

from palpate.launch.looking.rates import Rates

Say = Callable[[Rates], str | None]
"""Some lines about one publisher; None if too little has come to say anything."""


def rate_text(rates: Rates) -> str | None:
    """How often it sends."""
    rate, periods = rates.rate(), rates.periods()
    if rate is None:
        return None
    text = f"average rate: {rate:.3f}"
    if periods is None:
        return f"{text}\n\tno two neighbouring messages came {_window(rates)}"
    return (
        f"{text}\n\tmin: {periods.least:.6f}s max: {periods.most:.6f}s "
        f"std dev: {periods.deviation:.6f}s {_window(rates)}"
    )


def bandwidth_text(rates: Rates) -> str | None:
    """How much it sends."""
    bandwidth, sizes = rates.bandwidth(), rates.sizes()
    if bandwidth is None or sizes is None:
        return None
    mean, least, most = (_bytes(size) for size in sizes[:3])
    return (
        f"{_bytes(bandwidth)}/s from {rates.heard} messages\n"
        f"\tMessage size mean: {mean} min: {least} max: {most} {_window(rates)}"
    )


def delay_text(rates: Rates) -> str | None:
    """How long its messages are on their way to the tool."""
    delays = rates.delays()
    if delays is None:
        return None
    return (
        f"average delay: {delays.mean:.6f}\n\tmin: {delays.least:.6f}s max: {delays.most:.6f}s "
        f"std dev: {delays.deviation:.6f}s {_window(rates)}"
    )


def _window(rates: Rates) -> str:
    missed = rates.sent - rates.heard
    return f"window: {rates.heard}" + (f" ({missed} sent, but not heard)" if missed else "")


def _bytes(size: float) -> str:
    for unit, name in ((1e6, "MB"), (1e3, "KB")):
        if size >= unit:
            return f"{size / unit:.2f} {name}"
    return f"{size:.0f} B"
