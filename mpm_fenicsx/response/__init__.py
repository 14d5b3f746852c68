"""What a law adds to the elastic step: residual and tangent on the grid."""
