"""What is said (`types`), how it travels (`codec`, `bus`), how it is kept (`recording`)."""
