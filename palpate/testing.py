"""Functions for tests of nodes: drive nodes by plain calls, or feed them a recording."""

from palpate.nodes.runtime.testing import (
    assert_same,
    drive,
    drive_together,
    example,
    feed,
    messages_on,
    recorded,
)

__all__ = [
    "assert_same",
    "drive",
    "drive_together",
    "example",
    "feed",
    "messages_on",
    "recorded",
]
