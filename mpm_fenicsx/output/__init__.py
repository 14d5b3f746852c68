"""Recorders and files. A recorder of your own goes here."""
