from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass
from typing import Annotated

import pytest

from palpate.messages.codec import decode, encode, schema_hash
from palpate.messages.fields import (
    Array,
    CodecError,
    Count,
    Floats,
    Metres,
    Seconds,
    SignalImage,
    Unit,
)
from palpate.messages.types.catalogue import TYPES


def test_what_is_no_message_is_refused():
    with pytest.raises(CodecError, match="int is not a message type"):
        encode(42)


def test_a_field_of_an_unknown_kind_is_refused():
    @dataclass(frozen=True)
    class Odd:
        where: complex

    with pytest.raises(CodecError, match="no message field can be a <class 'complex'>"):
        encode(Odd(1j))


def test_a_type_with_one_field_comes_back():
    back = decode(One, encode(One(length=2.0)))
    assert back.length == 2.0


@dataclass(frozen=True)
class One:
    length: Metres


@dataclass(frozen=True)
class OneInSeconds:
    length: Seconds


@dataclass(frozen=True)
class OneRenamed:
    width: Metres


@dataclass(frozen=True)
class OneMore:
    length: Metres
    count: Count


@dataclass(frozen=True)
class Image:
    length: SignalImage


@dataclass(frozen=True)
class OtherImage:
    length: Annotated[Floats, Array("<f8", (None, 3), "s")]


@dataclass(frozen=True)
class OneInMillimetres:
    length: Annotated[float, Unit("mm")]


def test_the_hash_changes_with_unit_name_fields_and_shape():
    kinds = (One, OneInSeconds, OneRenamed, OneMore, Image, OtherImage, OneInMillimetres)
    for kind in kinds:
        kind.__name__ = "Same"  # the title is part of the schema
    assert len({schema_hash(kind) for kind in kinds}) == len(kinds)


def test_the_hash_is_the_same_in_another_process():
    program = (
        "from palpate.messages.codec import schema_hash\n"
        "from palpate.messages.types.catalogue import TYPES\n"
        "print([schema_hash(cls) for cls in TYPES.values()])"
    )
    here = [schema_hash(cls) for cls in TYPES.values()]
    there = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        timeout=300,
        check=True,
        env={"PYTHONHASHSEED": "12345"},
    )
    assert there.stdout.strip() == str(here)
