"""Building blocks of all stages: streams and queues, delays, shifters, records, counters.

May import: spec.
"""
