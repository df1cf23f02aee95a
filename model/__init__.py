"""Scene files, cameras, generated scenes, packing: everything from a scene to a model in DRAM."""
