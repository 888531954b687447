"""Working examples of a node, a driver, an effect and a planner, which palpate init copies.

They are read as text: names that hold the word Template, and the first lines, are replaced by
palpate.tools.init.
"""
