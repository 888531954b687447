"""Changes of single lines of the product: how many of them some test catches."""
