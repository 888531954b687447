"""Starting graphs: launch files and scenes, checked graphs, processes, runs and their summary.

A graph is checked whole before anything is started or written; whatever a user gave and cannot be
used becomes one sentence with file and line. Launch files and scenes lie here too; limits,
displays and texts may be changed, the order of checks in `check_run` had better not. Rests on
palpate.nodes and on launch.files and launch.processes.
"""
