"""Arrays from outside, arrays that are copies of what the engine holds, and types of arrays."""
