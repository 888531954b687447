"""The command line: one chapter a family of verbs, all imported only when a verb is called.

Verbs parse arguments and print; whatever they do is a function of another room. A new verb is a
click command in its family and one line in `command_line`. Rests on click, and lazily on
everything else.
"""
