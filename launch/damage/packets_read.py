"""Reads messages, frames and words, and looks whether what was accepted is valid."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from palpate.launch.damage.messages import Packet
from palpate.messages.bus import join
from palpate.messages.bus.words import OF_LAUNCHER, OF_NODES, read_word
from palpate.messages.codec import decode, encode
from palpate.messages.header import pack_frame, split_frame
from palpate.messages.types import TYPES

WORDS = {"node": OF_NODES, "launcher": OF_LAUNCHER}


def read_packet(packet: Packet) -> None:
    """Read bytes with their reader.

    Raises
    ------
    ValueError
        If they are refused.
    AssertionError
        If they are accepted and not valid.
    """
    reader, data = packet
    if reader in TYPES:
        _read_body(TYPES[reader], data)
    elif reader == "frame":
        _sound(pack_frame(*split_frame(data)) == data, "a frame is not what it was read from")
    elif reader == "answer":
        answer = join.read_answer(data)
        if answer.kind == join.HELLO:
            join.read_epoch(answer.rest)
    elif reader == "request":
        request = join.read_request(data)
        if request is None:
            raise ValueError("no request")
        _sound(request.wanted < 1 << 64 and (request.epoch or 0) < 1 << 64, "a request is too far")
    else:
        read_word(data, WORDS[reader])


def _read_body(cls: type, data: bytes) -> None:
    message: Any = decode(cls, data)
    for field in dataclasses.fields(cls):
        value = getattr(message, field.name)
        if type(value) is float or (isinstance(value, np.ndarray) and value.dtype.kind == "f"):
            _sound(bool(np.isfinite(value).all()), f"{field.name} is not finite")
    body = encode(message)
    _sound(encode(decode(cls, body)) == body, "a message is not what it was read from")


def _sound(holds: bool, fault: str) -> None:
    if not holds:
        raise AssertionError(fault)
