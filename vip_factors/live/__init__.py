"""Near-online estimation: samples come in one by one, and every frame gets its answer while the stream goes on."""
