"""Addresses of machines, free ports, and the file of the key."""

from __future__ import annotations

import errno
import os
import random
import re
import socket
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from pathlib import Path

from palpate.launch.files.source_map import InputError

PORTS, TRIED_PORTS = range(10_000, 32_768), 1000  # Of nodes; higher ones go to who connects
PORT = 7447  # Where a machine that lends itself listens, unless the user wants another
_HOST = re.compile(r"(\d{1,3}(?:\.\d{1,3}){3}|[a-z0-9][a-z0-9.-]*)(?::(\d{1,5}))?", re.IGNORECASE)


def key_file() -> Path:
    """The user's key."""
    config = os.environ.get("XDG_CONFIG_HOME") or "~/.config"
    return Path(config).expanduser() / "palpate" / "graph.key"


def own_address(towards: str) -> str:
    """The address by which another machine reaches this one; ValueError if there is no way."""
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.connect((towards, PORT))
            return str(probe.getsockname()[0])
    except OSError as error:
        raise ValueError(f"host {towards} cannot be reached: {error.strerror or error}") from None


def read_host(text: str) -> tuple[str, int]:
    """Address and port of a machine, as ``192.168.1.5`` or ``lab2:7447``.

    Raises InputError if it is no such address.
    """
    found = _HOST.fullmatch(text)
    port = int(found[2] or PORT) if found else 0
    if found is None or not 0 < port < 1 << 16:
        raise InputError(f"host {text!r} must look like 192.168.1.5 or lab2:{PORT}")
    return found[1], port


def free_endpoints(address: str, names: Iterable[str]) -> dict[str, str]:
    """An endpoint for each name, at ports of this machine that are free now.

    None of those that the system gives to whoever connects: such a one may be taken before its node
    has bound it. Raises ValueError if the address is none of this machine's, or no port is free.
    """
    endpoints, ports = {}, iter(random.sample(PORTS, TRIED_PORTS))
    with ExitStack() as held:
        for name in names:
            one = held.enter_context(socket.socket())
            endpoints[name] = f"tcp://{address}:{_bound(one, address, ports)}"
    return endpoints


def _bound(one: socket.socket, address: str, ports: Iterator[int]) -> int:
    """The first port that is free, to which the socket is bound then."""
    for port in ports:
        try:
            one.bind((address, port))
        except OSError as error:
            if error.errno != errno.EADDRINUSE:
                raise ValueError(
                    f"{address} is no address of this machine: {error.strerror}"
                ) from None
        else:
            return port
    raise ValueError(f"{address} has no free port: {TRIED_PORTS} of {PORTS} were tried")
