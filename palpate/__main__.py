"""``python -m palpate`` is the command line."""

from __future__ import annotations

from palpate.tools.cli.command_line import main

if __name__ == "__main__":
    main()
