"""The background grid, and everything that knows DOLFINx."""
