"""Servers: who may talk to them, and the threads that they run in."""
