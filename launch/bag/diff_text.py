"""How two recordings compare, as lines for people."""

from __future__ import annotations

from palpate.launch.bag.diff import Diff

HEAD = ("topic", "compared", "differ", "only in A", "only in B")


def diff_text(diff: Diff) -> str:
    """The first difference, and a line for each topic that differs."""
    lines = [f"{path} was never closed: comparing as far as it goes" for path in diff.unfinished]
    if not diff.first:
        count = sum(one.compared for one in diff.topics.values())
        lines.append(f"identical, {_many(count, 'message')} on {_many(len(diff.topics), 'topic')}")
        return "\n".join(lines)
    rows = [HEAD]
    for topic, one in diff.topics.items():
        if not one.identical:
            compared, differ, only_a, only_b = one.compared, one.differ, one.only_a, one.only_b
            rows.append((topic, str(compared), str(differ), str(only_a), str(only_b)))
    width = max(len(row[0]) for row in rows)
    lines.append(f"first difference: {diff.first}")
    for topic, *figures in rows:
        cells = (figure.rjust(len(head)) for figure, head in zip(figures, HEAD[1:], strict=True))
        lines.append("  ".join((topic.ljust(width), *cells)))
    same = sum(one.identical for one in diff.topics.values())
    lines.append(f"identical on {same} of {_many(len(diff.topics), 'topic')}")
    return "\n".join(lines)


def _many(count: int, what: str) -> str:
    return f"{count} {what}" if count == 1 else f"{count} {what}s"
