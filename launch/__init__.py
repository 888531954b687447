"""Starting graphs: launch files and scenes, checked graphs, processes, runs and their summary.

A graph is checked completely before anything is started or written. An input that cannot be used
raises an `InputError`, one sentence with file and line. The package also holds the shipped launch
files and scenes. The order of checks in `check_run` is fixed. This package uses `palpate.nodes`;
files that users give are read in `files`, and processes are run in `processes`.
"""
