"""From a recording to a factor graph and back."""
