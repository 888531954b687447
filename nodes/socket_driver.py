"""Driver node of a live sensor, which sends frames as lines over a TCP connection."""

from __future__ import annotations

import ipaddress
import os
import select
import socket
from collections.abc import Iterator
from contextlib import closing
from typing import Annotated

from msgspec import Meta

from palpate.messages.types import SequenceEnd
from palpate.nodes.runtime.node import Finished, Source, Timed
from palpate.nodes.specs.frames import (
    DRIVER_OUTPUTS,
    SensorParams,
    is_header,
    parse_row,
    placement_column,
    sensor_info,
    tactile_frame,
)

LOOPBACK = "127.0.0.1"
MAX_LINE_BYTES = 1 << 18  # of a line: 64 by 64 taxels take about 100 kB


class Params(SensorParams, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the launch file may set."""

    # Address of the sensor: a port of this machine, or ``192.0.2.7:5555`` for another one.
    address: str
    # Frame rate if the lines have no times [Hz].
    rate: Annotated[float, Meta(gt=0, le=1e4, description="Hz")] = 10.0

    def __post_init__(self) -> None:
        parse_address(self.address)


def parse_address(address: str) -> tuple[str, int]:
    """Address and port; the address of this machine if only a port is given.

    Raises ValueError if it is no numeric address, or no port.
    """
    host, _, port = address.rpartition(":")
    host = host.replace("localhost", LOOPBACK) or LOOPBACK
    try:
        if not (port.isascii() and port.isdecimal() and 0 < int(port) < 1 << 16):
            raise ValueError
        return str(ipaddress.IPv4Address(host)), int(port)
    except ValueError:
        raise ValueError(
            f"address is {address!r:.60}; expected a port such as 5555, or 192.0.2.7:5555"
        ) from None


def listen(params: Params) -> Iterator[Timed | Finished | None]:
    """The sensor, and each frame as it comes, until the sensor closes the connection.

    Raises ValueError if the address cannot be reached, the connection breaks, or a line is no
    frame.
    """
    yield Timed(0.0, "/touch/info", sensor_info(params))
    touch, shape, began, is_first = 0, (params.sensor.rows, params.sensor.cols), 0.0, True
    time, column, placement = 0.0, None, 0
    for line in _lines(params.address):
        if line is None:
            yield None
            continue
        has_header, is_first = is_first and is_header(line), False
        if has_header:
            column = placement_column(line)
        if has_header or not line.strip():
            continue
        row = parse_row(line, f"{params.address}: frame {touch}", shape, column, placement)
        placement = row.placement
        time = touch / params.rate if row.time is None else row.time
        began = time if touch == 0 else began
        frame = tactile_frame(params, touch, time - began, row.pose, row.image, placement)
        yield Timed(0.0, "/touch/raw", frame)
        touch += 1
    yield Timed(0.0, "/touch/end", SequenceEnd(frames=touch, robot_time=time - began))
    yield Finished(f"{params.address} closed the connection after {touch} frames")


def _lines(address: str, timeout: float = 0.1) -> Iterator[str | None]:
    """Lines as they come, and None after each `timeout` [s] without data."""
    with closing(socket.socket(socket.AF_INET, socket.SOCK_STREAM)) as line:
        line.setblocking(False)
        line.connect_ex(parse_address(address))
        while not select.select((), (line,), (), timeout)[1]:
            yield None
        fault = line.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
        if fault:
            raise ValueError(f"{address}: cannot be reached: {os.strerror(fault)}")
        rest = b""
        while True:
            if not select.select((line,), (), (), timeout)[0]:
                yield None
                continue
            try:
                data = line.recv(1 << 16)
            except OSError as error:
                raise ValueError(f"{address}: the connection broke: {error.strerror}") from None
            *lines, rest = (rest + data).split(b"\n")
            if not data and rest:
                lines.append(rest)
            yield from (_text(text, address) for text in lines)
            if not data:
                return
            if len(rest) > MAX_LINE_BYTES:
                raise ValueError(f"{address}: sent a line of more than {MAX_LINE_BYTES >> 10} kB")


def _text(line: bytes, address: str) -> str:
    try:
        return line.decode()
    except UnicodeDecodeError as error:
        raise ValueError(f"{address}: sent what is no text: {error.reason}") from None


SOURCE = Source(params=Params, outputs=lambda params: DRIVER_OUTPUTS, open=listen, repeats=False)
