"""Commands for graphs on several machines: lend this one, and make their key.

Optional, with `palpate.launch.hosts`: found by entry points.
"""
