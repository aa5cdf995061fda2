"""Looking at recordings and estimates in Rerun."""
