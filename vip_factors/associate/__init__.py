"""Association (thesis 4.3.2): which 2D detection shows which wearer of sensors."""
