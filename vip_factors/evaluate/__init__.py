"""How good an estimate is, against a reference."""
