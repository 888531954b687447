from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import msgspec
import numpy as np
import pytest

from palpate.messages.codec import encode
from palpate.messages.fields import CodecError
from palpate.messages.types.catalogue import LogRecord
from palpate.messages.types.touch import TactileImage
from palpate.messages.types.world import SensorInfo, World
from palpate.nodes import curvature, filter
from palpate.nodes.runtime.node import Finished, Node, Outputs, Source, Timed
from palpate.nodes.runtime.testing import assert_same, drive, example, messages_on
from palpate.nodes.runtime.work import ContractError


class Params(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    prefix: str = "got"
    topic: str = "/out"


def line(text: str) -> LogRecord:
    return LogRecord(node="n", level="info", text=text, robot_time=2.5)


def on_line(params: Params, count: int, message: LogRecord) -> tuple[int, Outputs]:
    if message.text == "end":
        return count, [Finished("done")]
    return count + 1, [(params.topic, line(f"{params.prefix} {count} {message.text}"))]


NODE = Node(
    params=Params,
    start=lambda params: (0, []),
    inputs={"/in": (LogRecord, on_line), "/need": (LogRecord, on_line)},
    outputs={"/out": LogRecord},
    needs=("/need",),
)


def texts(published: list[Any]) -> list[str]:
    return [one.reason if isinstance(one, Finished) else one[1].text for one in published]


def test_a_node_publishes_what_its_handlers_return_once_its_needs_have_come():
    received = [("/in", line("a")), ("/in", line("b"))]
    assert drive(NODE, received) == []
    published = drive(NODE, [*received, ("/need", line("n")), ("/in", line("end"))])
    assert texts(published) == ["got 0 n", "got 1 a", "got 2 b", "done"]


@pytest.mark.parametrize("params", [{"prefix": "had"}, Params(prefix="had")])
def test_parameters_may_be_a_map_or_an_instance(params: object):
    assert texts(drive(NODE, [("/need", line("n"))], params)) == ["had 0 n"]


@pytest.mark.parametrize(
    ("received", "params", "error", "words"),
    [
        (
            [("/inn", line("n"))],
            None,
            ValueError,
            "does not subscribe to /inn; it subscribes to /in, /need",
        ),
        ([("/in", 3)], None, ValueError, "subscribes to /in as LogRecord, got a int"),
        ([("/in", replace(line("n"), robot_time=np.nan))], None, CodecError, "must be finite"),
        ([], {"sais": 1}, ValueError, "the parameters do not fit: .*sais"),
        ([], {"prefix": 1}, ValueError, "the parameters do not fit: Expected `str`"),
        ([], {"prefix": object()}, ValueError, "the parameters do not fit"),
        ([("/need", line("n"))], {"topic": "/no"}, ContractError, "node published /no, which"),
    ],
)
def test_what_the_runtime_would_refuse_is_refused(
    received: list[Any], params: object, error: type[Exception], words: str
):
    with pytest.raises(error, match=words):
        drive(NODE, received, params)


def test_a_handler_that_writes_into_its_input_is_found():
    def spoil(params: Params, state: None, image: TactileImage) -> tuple[None, Outputs]:
        image.compression[0, 0] = 1.0
        return None, []

    node = replace(NODE, inputs={"/in": (TactileImage, spoil)}, needs=())
    image = example(TactileImage, compression=np.zeros((4, 4)))
    with pytest.raises(ValueError, match="read-only"):
        drive(node, [("/in", image)])


def test_what_one_node_publishes_can_be_given_to_the_next(info: SensorInfo):
    from palpate.messages.types.touch import TactileFrame

    frame = example(
        TactileFrame,
        pose=np.array([0.0, 0, 0, 0, 0, 0, 1]),
        outcome="miss",
        array=np.full((16, 16), 2 * info.thickness / info.sound_speed),
    )
    images = drive(filter.NODE, [("/touch/info", info), ("/touch/raw", frame)])
    patches = drive(curvature.NODE, [("/touch/info", info), *images, Finished("end")])
    assert [patch.kind for patch in messages_on(patches, "/touch/patch")] == ["miss"]
    assert messages_on([*patches, Finished("end")], "/touch/image") == []


def source(*published: object, **declared: type) -> Source:
    def opened(params: Params) -> Iterator[Any]:
        yield from published

    outputs = {"/out": LogRecord, **{f"/{name}": cls for name, cls in declared.items()}}
    return Source(params=Params, outputs=lambda params: outputs, open=opened)


def test_a_source_is_driven_to_its_end_and_bodies_are_decoded():
    body = encode(line("b"))
    one = source(
        Timed(0.0, "/out", line("a")),
        None,
        Timed(0.1, "/out", body),
        Finished("e"),
        Timed(1, "/x", 1),
    )
    assert texts(drive(one)) == ["a", "b", "e"]
    assert texts(drive(one, most=1)) == ["a"]


@pytest.mark.parametrize(
    ("published", "words"),
    [
        (Timed(0.0, "/x", line("a")), "published /x, which it does not declare; it declares /out"),
        (Timed(0.0, "/out", example(World)), "published a World on /out, declared as LogRecord"),
    ],
)
def test_a_source_that_publishes_what_it_does_not_declare_is_refused(published: Timed, words: str):
    with pytest.raises(ContractError, match=words):
        drive(source(published))


def test_a_source_is_given_no_inputs():
    with pytest.raises(ValueError, match="a source subscribes to nothing"):
        drive(source(), [("/in", line("a"))])


def test_an_example_has_the_fields_that_matter_and_plain_ones_otherwise():
    image = example(TactileImage, touch=3)
    assert (image.touch, image.outcome, image.mask.shape) == (3, "hit", (0, 0))
    with pytest.raises(ValueError, match="a World has no hight; it has platform, held, reach"):
        example(World, hight=1)
    with pytest.raises(CodecError, match="seed must be int"):
        example(World, seed="x")


def test_every_message_type_has_an_example():
    from palpate.messages.types.catalogue import TYPES

    for cls in TYPES.values():
        assert encode(example(cls))


def test_messages_that_are_the_same_to_the_last_bit_are_the_same():
    published = [("/out", line("a")), Finished("done")]
    assert_same(published, [("/out", line("a")), Finished("done")])


@pytest.mark.parametrize(
    ("expected", "words"),
    [
        ([("/out", line("b"))], r"^0: /out text: published 'a', expected 'b'$"),
        (
            [("/other", line("a"))],
            r"^0: published a LogRecord on /out, expected a LogRecord on /other$",
        ),
        ([("/out", example(World))], r"expected a World on /out$"),
        ([Finished("a")], r"^0: published a LogRecord on /out, expected Finished\('a'\)$"),
        ([], r"^published 1, expected 0; more was published: a LogRecord on /out$"),
        (
            [("/out", line("a")), Finished("end")],
            r"^published 1, expected 2; not published: Finished\('end'\)$",
        ),
    ],
)
def test_the_first_difference_is_told(expected: list[Any], words: str):
    with pytest.raises(AssertionError, match=words):
        assert_same([("/out", line("a"))], expected)


def test_a_zero_that_changed_its_sign_is_a_difference():
    one, other = (example(World, reach=value) for value in (0.0, -0.0))
    with pytest.raises(AssertionError, match=r"reach: published 0.0, expected -0.0"):
        assert_same([("/world", one)], [("/world", other)])
