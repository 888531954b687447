"""For the tests of your own nodes: drive one by plain calls, or feed it a recording."""

from __future__ import annotations

from palpate.nodes.testing import drive
from palpate.nodes.testing_messages import assert_same, example, messages_on
from palpate.nodes.testing_recorded import feed, recorded

__all__ = ["assert_same", "drive", "example", "feed", "messages_on", "recorded"]
