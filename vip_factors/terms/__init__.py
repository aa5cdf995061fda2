"""One residual per file."""
