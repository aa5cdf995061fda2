"""The same objective as a ``gtsam.NonlinearFactorGraph``: to look at, to extend, to hold the fast solver against."""
