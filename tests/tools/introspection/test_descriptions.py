import json
from dataclasses import dataclass

import msgspec
import pytest

from palpate.launch.files.source_map import InputError
from palpate.launch.node_kinds import list_kinds
from palpate.messages.codec import schema
from palpate.messages.fields import Count, PerMetre
from palpate.messages.types.catalogue import TYPES
from palpate.nodes.filter import Params
from palpate.nodes.runtime.node import RecordedNode
from palpate.tools.introspection.descriptions import (
    describe_kind,
    describe_param,
    find_interface,
    interface_text,
    kind_text,
    param_text,
    parameters_of,
)
from palpate.tools.introspection.requests import dump_params


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Bends:
    goal: Count
    curvature: PerMetre


@pytest.fixture
def filtering(card):
    """A graph whose filter looks at less than others do."""
    cleaner = RecordedNode(
        name="cleaner",
        module="palpate.nodes.filter",
        params=msgspec.Raw(msgspec.json.encode(Params(contact=1e-4))),
        inputs=(),
        outputs={},
    )
    return msgspec.structs.replace(card, nodes=(*card.nodes, cleaner))


def test_a_parameter_has_type_default_and_the_comment_of_its_source():
    order, contact = parameters_of(Params).values()
    assert order.type == "auto | median | median-first | none | wiener | wiener-first"
    assert order.default == "auto"
    assert order.help.startswith("Which filters, and which of them first")
    assert contact.type == "number > 0 and <= 0.001"
    assert contact.default == "5.0e-05"
    assert contact.help.startswith("Least compression that counts as touched")


@pytest.mark.parametrize("name", list_kinds())
def test_every_kind_says_what_it_is_and_explains_each_of_its_parameters(name):
    first, told, *_ = kind_text(describe_kind(name)).splitlines()
    assert first == name
    assert told.endswith((".", ",", ":")) or len(told) > 20
    lines = kind_text(describe_kind(name)).splitlines()
    params = [place for place, line in enumerate(lines) if line.startswith("  takes ")]
    for place in params:
        assert lines[place + 1].startswith(" " * 8), lines[place]


def test_a_required_parameter_is_told_to_be_required():
    assert "  takes object  ObjectSpec  required" in kind_text(describe_kind("simulator"))
    with pytest.raises(InputError, match="there is no kind"):
        describe_kind("none")


def test_the_parameters_of_one_node_or_of_all_are_told(filtering):
    assert list(dump_params(filtering, "cleaner")) == ["cleaner"]
    assert list(dump_params(filtering)["cleaner"]["params"]) == ["order", "contact"]
    with pytest.raises(ValueError, match=r"no node 'cleanr'; did you mean 'cleaner'\?"):
        dump_params(filtering, "cleanr")


def test_a_parameter_is_told_with_its_value_in_this_graph(filtering):
    lines = param_text(describe_param(filtering, "cleaner", "contact")).splitlines()
    assert lines[0] == "value: 0.0001"
    assert lines[-1] == "default: 5.0e-05"
    assert any(line.startswith("help: ") for line in lines)


def test_of_a_node_of_one_s_own_the_value_is_told_and_its_module_left_be(card):
    talker = msgspec.structs.replace(card.nodes[0], module="my_lab.talker")
    card = msgspec.structs.replace(card, nodes=(talker,))
    assert describe_param(card, "talker", "deep.pose") == {"value": [1.5]}
    with pytest.raises(ValueError, match=r"talker has no parameter 'sise'; did you mean 'size'\?"):
        describe_param(card, "talker", "sise")
    with pytest.raises(ValueError, match=r"talker has no parameter 'size\.x'"):
        describe_param(card, "talker", "size.x")


@pytest.mark.parametrize("name", TYPES)
def test_every_type_is_shown_with_all_its_fields(name):
    lines = interface_text(find_interface(name, dict.fromkeys(TYPES, ""))).splitlines()
    assert lines[0] == name
    shown = {line.split()[0] for line in lines[1:] if line.split()}
    assert shown >= set(TYPES[name].__dataclass_fields__)


def test_a_type_of_one_s_own_is_shown_from_its_schema():
    known = {"Bends": json.dumps(schema(Bends))}
    text = interface_text(find_interface("Bends", known))
    assert "goal       integer  #" in text
    assert "curvature  number  1/m" in text
    with pytest.raises(ValueError, match=r"there is no type 'Bend'; did you mean 'Bends'\?"):
        find_interface("Bend", known)
