"""The page in the browser: what is drawn, how, and what a person can do with it."""
