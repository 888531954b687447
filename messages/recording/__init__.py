"""How messages are kept: one MCAP file a run, written whole records at a time."""
