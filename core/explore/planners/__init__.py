"""Which slice to trace next, and when to stop: pure functions of what is known."""
