"""What ``palpate init`` copies: working examples to change."""
