"""Floaters: planted, grown, and pruned by what photographs say."""
