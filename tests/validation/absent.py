"""Cells of the validation table that stay empty: where the case's name begins, the mappings, and
why."""

LINEAR = "MPM CMPM DM DM-C"
TILING = "GIMP DM-G DM-GC DM-GCL"
AT_POINTS = "MPM GIMP CMPM"
BUT_DM_GC = "FE MPM GIMP CMPM DM DM-G DM-C DM-GCL"
BUT_FE = "MPM GIMP CMPM DM DM-G DM-C DM-GC DM-GCL"
BUT_FE_AND_DM_GC = "MPM GIMP CMPM DM DM-G DM-C DM-GCL"

OVER_SIDES = "stress that is linear over support domains does not go on over tied sides"
OPTION = "one or two mappings show this variant"
SHOWN = "the mapping fails already where that is easier"
FITS = "elements lie on the body: nothing crosses cells or cuts them"
ALONE = "a mesh is one body"
SLOPES = "the grid has no lines along a slope: elements would need a mesh of their own"
TWIN = "the others are compared with it"
B_BAR = "b_bar is for integrals at Gauss points"

ABSENT = (
    ("1 compaction, E = 1 MPa, 4 % strain, untied", "FE", FITS),
    ("1 compaction, E = 1 MPa, 4 % strain, untied", f"GIMP DM-G {LINEAR}", OPTION),
    ("3 Prandtl, B-bar", AT_POINTS, B_BAR),
    (
        "5 manufactured, 31 % strain, 80 cells, 16 points a cell",
        "FE MPM GIMP CMPM DM DM-G DM-C DM-GC",
        OPTION,
    ),
    ("5 vortex", LINEAR, SHOWN),
    ("6 vibration at 3 % of strain: energy lost or gained, spectral radius", BUT_DM_GC, OPTION),
    ("6 vibration at 3 % of strain: energy lost or gained", "FE", FITS),
    ("6 vibration, 10,000 steps: energy, ", BUT_DM_GC, OPTION),
    ("6 vibration, 10,000 steps: period, ", BUT_DM_GC, OPTION),
    ("7 free block, ", "MPM GIMP CMPM DM DM-G DM-C", OPTION),
    ("7 ", "FE", FITS),
    ("8 crossing cells, bar disturbed by 1 %, Courant 2", LINEAR, SHOWN),
    ("8 crossing cells, bar disturbed by 1 %, spectral", LINEAR, SHOWN),
    ("8 block at 95 % of yield, softening, Courant 5, 300 steps", LINEAR, SHOWN),
    (
        "8 block at 95 % of yield, softening, Courant 5, disturbed",
        "MPM GIMP CMPM DM DM-G DM-C",
        OPTION,
    ),
    ("8 ", "FE", FITS),
    ("9 S waves on dashpots, ν = 0.41, 60°, B-bar", AT_POINTS, B_BAR),
    ("9 S waves on dashpots, ν = 0.41, 60°, lumped correction", f"FE {LINEAR}", OPTION),
    ("10 Lamb", BUT_FE_AND_DM_GC, OPTION),
    ("12 compliant base, ", BUT_FE_AND_DM_GC, OPTION),
    *(
        (f"11 {case}", mappings, why)
        for case in ("slope on rollers", "slope in 3D")
        for mappings, why in (("FE", FITS), ("CMPM MPM DM DM-G DM-C DM-GCL", OPTION))
    ),
    *((f"11 {name}", "FE", FITS) for name in ("block", "embankment", "slope", "step")),
    ("13 foundation", BUT_DM_GC, OPTION),
    ("13 ", "FE", FITS),
    ("14 ", "FE", FITS),
    ("15 strip overloaded to 60 kPa, DeadLoad", "FE CMPM DM DM-G DM-C DM-GC DM-GCL", OPTION),
    ("15 strip overloaded to 60 kPa, Traction", BUT_DM_GC, OPTION),
    ("15 strip overloaded to 60 kPa, Δt = 1.25 ms", "FE MPM GIMP CMPM DM DM-C DM-GCL", OPTION),
    ("15 strip overloaded, settlement at 0.3 s against FE", "FE", TWIN),
    ("15 two bodies", "FE", ALONE),
    ("15 two bodies meet, uncorrected", BUT_FE_AND_DM_GC, OPTION),
    ("15 ν = 0.499, Lamé's mode, 1,000 steps, B-bar", AT_POINTS, B_BAR),
    ("16 bar tilted by 30°, dashpots at its ends, h = 0.125", BUT_FE_AND_DM_GC, OPTION),
    ("16 P wave along", BUT_DM_GC, OPTION),
    ("16 S wave along", BUT_DM_GC, OPTION),
    ("16 disc on dashpots", BUT_DM_GC, OPTION),
    ("collapse of a block, h = 1 m", BUT_DM_GC, OPTION),
    ("17 foundation", BUT_DM_GC, OPTION),
    ("17 struck ground", BUT_FE_AND_DM_GC, OPTION),
    ("17 layer, 20,000 steps", BUT_DM_GC, OPTION),
    ("17 ", BUT_FE, OPTION),
    *((f"16 {wave} packet", BUT_FE, OPTION) for wave in "PS"),
    ("18 Rankine", "MPM CMPM DM DM-C", OPTION),
    ("19 cavity, expansion, φ = 30°", "DM-G", SHOWN),
    ("19 cavity", "MPM GIMP CMPM DM DM-C DM-GCL", OPTION),
    ("20 strip", BUT_FE_AND_DM_GC, OPTION),
    ("21 Cam-Clay", "MPM GIMP CMPM DM DM-C DM-GCL", OPTION),
    ("22 slope of Griffiths and Lane", "FE", SLOPES),
    ("22 slope of Griffiths and Lane", "MPM GIMP CMPM DM DM-C DM-GCL", OPTION),
    ("22 slope at half its strength", "FE", SLOPES),
    ("22 slope at half its strength", "MPM GIMP CMPM DM DM-G DM-C DM-GCL", OPTION),
    ("24 ", "DM-GCL", OVER_SIDES),
    ("25 record of 40 s", "DM-GCL", OVER_SIDES),
    ("25 record of 40 s", "MPM CMPM DM DM-G DM-C", OPTION),
    ("26 ", BUT_FE_AND_DM_GC, OPTION),
)
