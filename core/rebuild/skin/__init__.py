"""A smooth surface through contours that correspond, and how far it can be trusted."""
