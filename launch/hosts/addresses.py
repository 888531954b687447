"""Addresses of machines, free ports, and the file of the key."""

from __future__ import annotations

import errno
import os
import random
import re
import socket
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path

from palpate.launch.files.source_map import InputError

NODE_PORTS = range(10_000, 32_768)  # higher ports are the system's for outgoing connections
DEFAULT_PORT = 7447  # at which the agent of a machine listens
_HOST = re.compile(r"(\d{1,3}(?:\.\d{1,3}){3}|[a-z0-9][a-z0-9.-]*)(?::(\d{1,5}))?", re.IGNORECASE)


def key_file() -> Path:
    """Path of the user's key."""
    config = os.environ.get("XDG_CONFIG_HOME") or "~/.config"
    return Path(config).expanduser() / "palpate" / "graph.key"


def own_address(towards: str) -> str:
    """The address at which another machine reaches this one; ValueError if it cannot."""
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.connect((towards, DEFAULT_PORT))
            return str(probe.getsockname()[0])
    except OSError as error:
        raise ValueError(f"host {towards} cannot be reached: {error.strerror or error}") from None


def read_host(text: str) -> tuple[str, int]:
    """Address and port of a machine, from ``192.168.1.5`` or ``lab2:7447``.

    Raises InputError if the text is no such address.
    """
    match = _HOST.fullmatch(text)
    port = int(match[2] or DEFAULT_PORT) if match else 0
    if match is None or not 0 < port < 1 << 16:
        raise InputError(f"host {text!r} must look like 192.168.1.5 or lab2:{DEFAULT_PORT}")
    return match[1], port


def free_endpoints(
    address: str,
    names: Iterable[str],
    ports: Sequence[int] = NODE_PORTS,
    max_tries: int = 1000,
) -> dict[str, str]:
    """An endpoint for each name, at free `ports` of this machine.

    `max_tries` random ports are tried for all names. Raises ValueError if the address is not one of
    this machine, or no port is free.
    """
    endpoints, candidates = {}, iter(random.sample(ports, max_tries))
    with ExitStack() as sockets:
        for name in names:
            bound = sockets.enter_context(socket.socket())
            if (port := _bind(bound, address, candidates)) is None:
                text = f"{max_tries} of {ports} were tried"
                raise ValueError(f"{address} has no free port: {text}")
            endpoints[name] = f"tcp://{address}:{port}"
    return endpoints


def _bind(unbound: socket.socket, address: str, ports: Iterator[int]) -> int | None:
    """Bind a socket to the first free port; returns the port, None if none is free."""
    for port in ports:
        try:
            unbound.bind((address, port))
        except OSError as error:
            if error.errno != errno.EADDRINUSE:
                raise ValueError(
                    f"{address} is no address of this machine: {error.strerror}"
                ) from None
        else:
            return port
    return None
