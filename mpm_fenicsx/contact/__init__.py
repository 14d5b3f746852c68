"""Runs of several bodies: surfaces that meet, gaps, impact, forces that only push."""
