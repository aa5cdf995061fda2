"""An estimate as one HTML page for people: what was found, how sure it is, and what it means."""
