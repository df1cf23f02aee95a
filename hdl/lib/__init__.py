"""Parts without a place of their own: streams and queues, delays, shifters, records, counters.

May import: spec.
"""
