"""TODO palpate.scenes."""
