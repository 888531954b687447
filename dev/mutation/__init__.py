"""Changes of single lines of the product, and how many of them a test catches."""
