"""What there is to draw: a model that stays, a state per instant. Neither knows who draws."""
