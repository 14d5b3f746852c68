"""Equilibrium, Newton's method and PETSc."""
