"""Where machines find each other: addresses, free ports, and the key that both have."""

from __future__ import annotations

import os
import re
import socket
from collections.abc import Iterable
from contextlib import ExitStack
from pathlib import Path

from palpate.launch.files import InputError

PORT = 7447  # Where a machine that lends itself listens, unless the user says otherwise
_HOST = re.compile(r"(\d{1,3}(?:\.\d{1,3}){3}|[a-z0-9][a-z0-9.-]*)(?::(\d{1,5}))?", re.IGNORECASE)


def key_file() -> Path:
    """The user's key."""
    config = os.environ.get("XDG_CONFIG_HOME") or "~/.config"
    return Path(config).expanduser() / "palpate" / "graph.key"


def read_host(text: str) -> tuple[str, int]:
    """Address and port of a machine, as ``192.168.1.5`` or ``lab2:7447``.

    Raises
    ------
    InputError
        If it is no such address.
    """
    found = _HOST.fullmatch(text)
    port = int(found[2] or PORT) if found else 0
    if found is None or not 0 < port < 1 << 16:
        raise InputError(f"host {text!r} must look like 192.168.1.5 or lab2:{PORT}")
    return found[1], port


def own_address(towards: str) -> str:
    """The address by which another machine reaches this one.

    Raises
    ------
    ValueError
        If there is no way to it.
    """
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.connect((towards, PORT))
            return str(probe.getsockname()[0])
    except OSError as error:
        raise ValueError(f"host {towards} cannot be reached: {error.strerror or error}") from None


def free_endpoints(address: str, names: Iterable[str]) -> dict[str, str]:
    """An endpoint for each name, at ports of this machine that are free now.

    Raises
    ------
    ValueError
        If the address is none of this machine's.
    """
    endpoints = {}
    with ExitStack() as held:
        for name in names:
            one = held.enter_context(socket.socket())
            try:
                one.bind((address, 0))
            except OSError as error:
                raise ValueError(
                    f"{address} is no address of this machine: {error.strerror}"
                ) from None
            endpoints[name] = f"tcp://{address}:{one.getsockname()[1]}"
    return endpoints
