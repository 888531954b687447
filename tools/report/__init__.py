"""Reports of runs: one self-contained page, for one run or two side by side.

Sections are rows of a table in `page`; what they say is collected in `run_facts`, and what the
three-dimensional view draws is packed in `view_data`. Rests on tools.view; `viewer` is the view's
program, bundled with three.js by its own package.json.
"""
