"""Where to touch an object's ends, off the contours, and when that is enough."""
