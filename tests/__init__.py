"""The tests, and in ``studies/`` what measures accuracy, speed and memory."""
