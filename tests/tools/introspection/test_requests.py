import hashlib

import pytest
from ruamel.yaml import YAML

from palpate.tools.introspection.echo import yaml_lines
from palpate.tools.introspection.requests import dump_params, find_node


def test_parameters_are_dumped_by_node_in_yaml(card):
    found = YAML(typ="safe", pure=True).load("\n".join(yaml_lines(dump_params(card))))
    assert set(found) == {"talker", "hearer"}
    assert found["hearer"] == {"params": {}}
    params = found["talker"]["params"]
    assert (params["size"], params["deep"]) == (3, {"pose": [1.5]})


def test_bytes_and_long_texts_are_named_by_size_and_hash(card):
    params = dump_params(card, "talker")["talker"]["params"]
    assert params["mesh"] == f"300 bytes, sha256 {hashlib.sha256(bytes(300)).hexdigest()}"
    text = ("some words " * 40).encode()
    assert params["text"] == f"440 bytes of text, sha256 {hashlib.sha256(text).hexdigest()}"


def test_a_node_that_is_not_there_is_refused_with_the_nearest(card):
    assert find_node(card, "/hearer").module == "my_lab.hearer"
    with pytest.raises(ValueError, match=r"no node 'talkr'; did you mean 'talker'\?"):
        dump_params(card, "talkr")
