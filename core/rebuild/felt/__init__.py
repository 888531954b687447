"""A side fitted to every touched taxel."""
