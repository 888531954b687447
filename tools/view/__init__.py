"""Runs to look at: what happened in robot time, drawn into images, films and the browser.

`timeline` is the one place that knows which messages are drawn; `rasteriser` draws without a
screen, `browser` in one. A picture never changes what a graph does. Rests on tools.bag and
tools.introspection.
"""
