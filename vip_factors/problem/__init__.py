"""What is to be found and from what: wearers, cameras and what they saw, the layout of variables, and their values."""
