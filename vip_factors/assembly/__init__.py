"""The objective: every term once, summed into a chain of all frames or into slices of a lag."""
