"""Confined-compression (oedometric) columns under a rolling cylinder."""
