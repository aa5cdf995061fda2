"""Looking at recordings, estimates and truth: a Rerun scene with plots, and a plain picture without any GPU."""
