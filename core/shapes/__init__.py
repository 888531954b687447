"""Objects that can be touched: one protocol, one file a shape."""
