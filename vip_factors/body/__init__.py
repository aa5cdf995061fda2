"""The wearer's body: a 24-joint skeleton in SMPL's topology, its kinematics, limits, prior and motion."""
