"""Tensors, checks, errors, compiled loops, files and ranks: what every room uses."""
