"""Facts about recordings and estimates as tables, for the report, the terminal and Rerun."""
