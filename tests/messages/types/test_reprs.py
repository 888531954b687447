"""Messages in a notebook: a line each, whatever they hold."""

import numpy as np
import pytest

from palpate.messages.types import TYPES
from palpate.nodes.runtime import example


@pytest.mark.parametrize("name", sorted(TYPES))
def test_a_message_is_told_in_one_short_line(name):
    message = example(TYPES[name])
    assert repr(message).startswith(f"{name}(")
    assert len(repr(message)) < 1000 and "\n" not in repr(message)


def test_a_full_model_is_told_by_its_shapes(tetrahedron):
    assert "vertices=<float64 (4, 3)>" in repr(tetrahedron)
    assert "uncertainty=[0.001]" in repr(tetrahedron)
    many = dict.fromkeys(map(str, range(30)), np.float64(1.0))
    assert "<dict of 30>" in repr(type(tetrahedron)(**{**fields_of(tetrahedron), "health": many}))


def fields_of(message):
    return {name: getattr(message, name) for name in message.__dataclass_fields__}
