"""Live sources: a recording played back, an MCAP file that still grows, standard input, TCP and WebSocket."""
