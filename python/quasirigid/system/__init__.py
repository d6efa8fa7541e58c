"""What processes have to know of each other."""
