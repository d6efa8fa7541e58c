"""What holds for all tests."""

import signal

# Tests end programs with Ctrl-C, in this process and in children. A shell that puts the tests in the background has them ignore it.
signal.signal(signal.SIGINT, signal.default_int_handler)
