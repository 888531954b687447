"""Running the nodes of a recording again, and saying what has become of what they said."""
