"""Exact answers; imports nothing of the package."""
