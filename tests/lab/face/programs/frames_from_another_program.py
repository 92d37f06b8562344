"""Make a dataset from frames that another program has stored as an array in a file, and identify the material."""

from pathlib import Path

import cv2
import numpy as np

import eimi_lab as eimi

frames, currents_A = np.load("frames.npy"), [0.0, 0.8, 1.5]
Path("frames").mkdir()
for number, frame in enumerate(frames):
    cv2.imwrite(f"frames/{number}.png", frame)
rows = [f"{number},{current_A}" for number, current_A in enumerate(currents_A)]
Path("states.csv").write_text("\n".join(["frame,current_A", *rows]) + "\n")
run = eimi.import_pictures("frames", "states.csv", "specimen.toml", "virtual_calibration", "taken.h5")
result = eimi.fit(run, "neo-hookean").initial_shear_modulus.value
