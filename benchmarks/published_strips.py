"""Fit two published photographs of soft bodies of Ecoflex 00-50: a hanging cantilever and a hanging spine.

    python -m benchmarks.published_strips

The script prints the modulus of the cantilever, of the spine, and of both together. The authors of the photographs
found 22.0 to 22.6 kPa with the cantilever and 78.6 to 79.9 kPa with the spine.

References
----------
DiffCal (repository diku-dk/DiffCal, GPL-3.0), folders ``exp_data/h_e_c`` and ``exp_data/h_e_s``.
"""

# DiffCal is a program of another group, which calibrates simulations of soft bodies with pictures. The pictures are
# published in its repository diku-dk/DiffCal (GPL-3.0), folders ``exp_data/h_e_c`` and ``exp_data/h_e_s``. They are not
# part of this project.
#
# The tables below contain positions of corners of the two bodies. A person marked the corners in picture 0 of each
# folder. Their positions in px were converted to mm in the plane in which the body bends. The conversion needs the pose
# of the camera, its focal length and the size of a square marker in the pictures:
#
# - The poses are published with the pictures. From one picture of a square, two poses are possible, which are mirror
#   images of each other. The published pose of picture 0 of the spine is the wrong one. The conversion uses the other.
# - The focal length (905 px) and the edge of the marker (20.0 mm) follow from the corners of the marker in four
#   pictures and the published poses.
# - Positions of the cantilever are divided by 1.03, so that its head has the length and width of the published CAD
#   model.
#
# The dimensions of the bodies are those of the CAD models (``CAD_models``). Their uncertainties and the uncertainties
# of the marked corners are assumed.

from __future__ import annotations

import tempfile
from pathlib import Path

import eimi_lab as eimi

CANTILEVER = """
[specimen]
name = "cantilever"
material = "Ecoflex 00-50"
length_mm = 170.0
width_mm = [[0, 30], [140, 30], [140, 60], [170, 60]]
depth_mm = 30.0
density_kg_m3 = 1070.0

[uncertainty]
length_mm = 1.5
width_mm = 0.5
depth_mm = 0.5
density_kg_m3 = 20.0
"""
# The blocks of the spine are 34 mm to 18 mm deep, the necks between them 7 mm to 4 mm. They bend over 20 mm.
SPINE = """
[specimen]
name = "spine"
material = "Ecoflex 00-50"
section = "plane-stress"
length_mm = 164.5
width_mm = 20.0
depth_mm = [
    [0, 7], [7, 7], [7, 34], [29.5, 34], [29.5, 7], [36.5, 7], [36.5, 30], [56.5, 30], [56.5, 6], [62.5, 6],
    [62.5, 28], [80.5, 28], [80.5, 6], [86.5, 6], [86.5, 26], [102.5, 26], [102.5, 5], [107.5, 5], [107.5, 24],
    [121.5, 24], [121.5, 5], [126.5, 5], [126.5, 22], [138.5, 22], [138.5, 4], [142.5, 4], [142.5, 20], [152.5, 20],
    [152.5, 4], [156.5, 4], [156.5, 18], [164.5, 18],
]
density_kg_m3 = 1070.0

[uncertainty]
length_mm = 1.5
width_mm = 0.5
depth_mm = 0.3
density_kg_m3 = 20.0
"""
HEADER = "state,point,x0_mm,y0_mm,x_mm,y_mm,sigma_mm"
CORNERS_OF_CANTILEVER = """
0,1,140,-15,88.06,-100.3,0.8
0,2,170,-30,93.2,-134.9,0.8
0,3,170,30,141.3,-98.6,1.5
0,4,140,15,116.5,-81.7,1.5
"""
CORNERS_OF_SPINE = """
0,Cl0,36.5,10,43.01,-16.10,1.0
0,Cl1,56.5,10,52.77,-33.11,1.0
0,Cr1,56.5,-10,35.65,-44.80,1.0
0,Dl0,62.5,10,57.15,-42.11,1.0
0,Dl1,80.5,10,62.46,-58.53,1.0
0,Dr0,62.5,-10,36.59,-48.94,1.0
0,Dr1,80.5,-10,42.27,-66.09,1.0
0,El0,86.5,10,64.69,-66.63,1.0
0,El1,102.5,10,67.87,-82.08,1.0
0,Er0,86.5,-10,43.72,-71.40,1.0
0,Er1,102.5,-10,47.68,-86.84,1.0
0,Fl0,107.5,10,69.54,-88.25,1.0
0,Fl1,121.5,10,72.14,-101.68,1.0
0,Fr0,107.5,-10,48.62,-92.49,1.0
0,Fr1,121.5,-10,51.45,-106.02,1.0
0,Gl0,126.5,10,73.75,-106.83,1.0
0,Gl1,138.5,10,75.81,-118.78,1.0
0,Gr0,126.5,-10,52.87,-111.96,1.0
0,Gr1,138.5,-10,55.13,-124.07,1.0
0,Hl0,142.5,10,77.39,-123.37,1.0
0,Hl1,152.5,10,79.38,-133.50,1.0
0,Hr0,142.5,-10,56.98,-128.71,1.0
0,Hr1,152.5,-10,59.14,-138.67,1.0
0,Il0,156.5,10,81.38,-137.89,1.0
0,Il1,164.5,10,82.38,-144.81,1.0
0,Ir0,156.5,-10,60.45,-142.14,1.0
0,Ir1,164.5,-10,62.06,-150.08,1.0
"""


def dataset(folder: Path, name: str, specimen: str, corners: str) -> Path:
    """Write the files of one photographed silicone body, import them, and return the path of the dataset.

    `specimen` is the text of the specimen file. `corners` are marked points of the body, rows of the file points.csv.
    """
    texts = {"toml": specimen, "points.csv": HEADER + corners, "states.csv": "state,field_mT\n0,0\n"}
    paths = {end: folder / f"{name}.{end}" for end in (*texts, "h5")}
    for end, text in texts.items():
        paths[end].write_text(text)
    tables = (paths["points.csv"], paths["states.csv"], paths["toml"], paths["h5"])
    with eimi.import_points(*tables, gravity_angle=-90.0) as imported:
        return imported.path


def main() -> None:
    with tempfile.TemporaryDirectory(prefix="published_strips") as name:
        folder = Path(name)
        cantilever = dataset(folder, "cantilever", CANTILEVER, CORNERS_OF_CANTILEVER)
        spine = dataset(folder, "spine", SPINE, CORNERS_OF_SPINE)
        print("| body | initial shear modulus, kPa | 95 % interval, kPa | mean error, mm | doubts |")
        print("| --- | --- | --- | --- | --- |")
        for body, paths in (("cantilever", [cantilever]), ("spine", [spine]), ("both", [cantilever, spine])):
            fit = eimi.fit(paths, "neo-hookean")
            modulus = fit.initial_shear_modulus
            low, high = (1e-3 * end for end in modulus.interval_95)
            row = (f"{1e-3 * modulus.value:.1f}", f"{low:.1f} to {high:.1f}", f"{fit.mean_error_mm:.1f}")
            print(f"| {' | '.join((body, *row, str(len(fit.doubts))))} |", flush=True)


if __name__ == "__main__":
    main()
