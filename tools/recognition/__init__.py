"""Which of the stored objects a solid is, or none of them.

Optional, with `palpate.core.recognition`: found as a command by its entry point.
"""
