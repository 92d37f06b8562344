"""Find where along the beam, and in which state, the measured edges differ from the simulated edges."""

import numpy as np

import eimi_lab as eimi

residuals = eimi.fit("run.h5", "neo-hookean").residuals()
near_the_tip = residuals.arc_length_mm > 20.0
for k, state in enumerate(residuals.state):
    for side, edge in enumerate(residuals.edge):
        distances = residuals.distance_mm[k, side][near_the_tip[k, side]]
        print(f"state {state}, {edge} edge beyond 20 mm: {1e3 * np.nanmean(distances):+.1f} µm")
result = residuals.distance_mm[near_the_tip]
