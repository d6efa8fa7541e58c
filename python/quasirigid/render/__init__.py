"""Pictures and films of a recording, without a browser."""
