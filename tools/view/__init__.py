"""Runs to look at: what happened in robot time, drawn into images, films and the browser.

`timeline` keeps the events of a run, and returns the drawables that are seen at a time;
`rasteriser` draws without a screen, `browser` in one. A picture never changes what a graph does.
Rests on tools.bag and tools.introspection.
"""
