"""Who speaks: the runtime, and one thin file for each node."""
