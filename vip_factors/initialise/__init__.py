"""Initial values: headings, mountings, poses, cameras and clocks."""
