"""From points to the grid and back: shape functions, patches, projection, and the table of
methods."""
