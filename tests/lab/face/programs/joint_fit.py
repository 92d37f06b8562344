"""Fit one law to several datasets together, and compare two laws on these datasets."""

from pathlib import Path

import eimi_lab as eimi

fits = eimi.fit(sorted(Path("runs").glob("*.h5")), ["neo-hookean", "yeoh"])
print(fits)
result = len(fits["yeoh"].datasets), fits.comparison[0].model, fits["neo-hookean"].initial_shear_modulus.value
