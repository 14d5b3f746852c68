"""Scenes whose answer is known, to start from and to measure by: each file builds one, as material
points and as finite elements, with its exact answer beside it."""
