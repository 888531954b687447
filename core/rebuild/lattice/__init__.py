"""A control lattice around an undeformed solid: Fung, 1999, 4.4."""
