"""For the tests of your own nodes: drive one by plain calls, or feed it a recording."""

from palpate.nodes.runtime.testing import assert_same, drive, example, feed, messages_on, recorded

__all__ = ["assert_same", "drive", "example", "feed", "messages_on", "recorded"]
