"""The command line: a module for each family of verbs, imported when a verb is called.

Verbs parse arguments and print; what they do is a function of another package. A new verb is a
click command in its family and one line in `command_line`. Rests on click, and lazily on
everything else.
"""
