"""Building blocks of all stages: streams, queues and credits, delays, shifters, records, counters.

May import: spec.
"""
