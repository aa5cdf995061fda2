"""Motion files: BVH and AMASS, on our skeleton."""
