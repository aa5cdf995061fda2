"""Who is who: which 2D detection shows which wearer of sensors (thesis 4.3.2)."""
