"""What a person does with graphs, runs and recordings: one chapter or room a tool.

Each chapter is one tool that may be changed or left out by itself; nothing below knows of it.
Rests on palpate.launch; the command line in tools.cli calls it.
"""
