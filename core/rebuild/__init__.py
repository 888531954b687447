"""From touches to a solid: skin, control lattice, closed ends."""
