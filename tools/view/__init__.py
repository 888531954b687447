"""Runs to look at: what happened in robot time, drawn into images, films and the browser.

`timeline` keeps what happened, and tells what is to be seen at a time as `tools.drawables` has it;
`rasteriser` draws without a screen, `browser` in one. A picture never changes what a graph does.
Rests on tools.bag and tools.introspection.
"""
