"""Where the optimiser starts: headings, mountings, and a pose per frame."""
