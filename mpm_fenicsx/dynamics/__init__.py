"""Rules of time, and the nodal fields that they advance: the only place with Newmark's factors."""
