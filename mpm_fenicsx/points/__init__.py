"""Material points, surface points, and where they lie."""
