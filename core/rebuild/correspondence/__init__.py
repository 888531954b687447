"""Which place of one slice belongs to which of the next: Fung, 1999, 4.2."""
