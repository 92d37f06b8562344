"""Fit every dataset of a folder separately, and put the moduli into one table."""

from pathlib import Path

import eimi_lab as eimi

rows = ["dataset,initial_shear_modulus_Pa,low_Pa,high_Pa"]
for path in sorted(Path("runs").glob("*.h5")):
    modulus = eimi.fit(path, "neo-hookean", output=path.with_suffix(".json")).initial_shear_modulus
    rows.append(f"{path.name},{modulus.value:.0f},{modulus.interval_95[0]:.0f},{modulus.interval_95[1]:.0f}")
Path("moduli.csv").write_text("\n".join(rows) + "\n")
result = rows
