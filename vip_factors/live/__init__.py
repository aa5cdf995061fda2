"""Near-online estimation: every frame of a stream gets an estimate as its samples arrive.

The entry point is :class:`~vip_factors.live.tracker.FixedLagTracker`.
"""
