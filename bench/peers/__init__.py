"""Comparisons with the programs and published figures of others."""
