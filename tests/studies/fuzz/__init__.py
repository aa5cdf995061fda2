"""Damaged input: files and streams of every format, mutated, and read; what is neither read nor refused is a fault."""
