"""Facts about recordings and estimates as tables, which a page, a terminal and Rerun's text lay out."""
