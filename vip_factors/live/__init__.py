"""Near-online estimation: samples come in one by one, and every frame gets its answer while the stream goes on.

:class:`~vip_factors.live.tracker.FixedLagTracker` is the way in.
"""
