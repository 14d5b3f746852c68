"""Loads, supports and boundaries, one idea a file. A boundary of your own goes here."""
