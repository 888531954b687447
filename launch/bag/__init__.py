"""What can be done with recordings: look into them, recover, compare, export and play them."""
