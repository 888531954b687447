"""For tests of nodes: drive one or several by plain calls, or feed one a recording."""

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
