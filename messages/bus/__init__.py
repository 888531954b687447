"""How messages travel: reliable topics, the lossy tap, and the control line to the launcher."""
