"""Tools that look at a running graph: they hear its taps, and ask its launcher."""
