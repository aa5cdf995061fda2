"""From our world, Z up, to one with Y up as animation programs have it."""

import numpy as np

R_YUP_WORLD = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""x stays, z becomes y, y becomes -z: what Blender and glTF do. At rest a body then faces z, its left along x."""
