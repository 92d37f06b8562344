"""How far found edges are from the true ones: a picture of a virtual beam, segmented, beside its simulated outline."""

import numpy as np

from eimi_fitting.laws import LAWS
from eimi_lab.config.rig import load_rig
from eimi_lab.config.specimen import load_specimen
from eimi_lab.virtual.simulation import simulate
from eimi_lab.virtual.virtual_rig import open_virtual_rig
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.edges.finding import find_edges


def main() -> float:
    """Root mean square distance in pixels."""
    rig, specimen, current_A = load_rig("virtual"), load_specimen("type1"), 1.0
    supply, camera, clock, truth = open_virtual_rig(rig, specimen)
    supply.set_voltage(12.0)
    supply.set_current(current_A)
    supply.set_output(True)
    clock.sleep(1.0)
    found = find_edges(camera.grab(1.0).image, rig.calibration, specimen)
    law, parameters = LAWS[truth["model"]], np.array(list(truth["parameters"].values()))
    field_mT = np.array([current_A * rig.calibration.coil_constant_mT_per_A])
    frame = BeamFrame(rig.calibration)
    true = simulate(specimen, law, parameters, field_mT, frame.gravity_deg, frame.field_deg).edges_mm[0]
    distances = []
    for edge, curve in zip((found.left.points_mm, found.right.points_mm), true, strict=True):
        start, side = curve[:-1], np.diff(curve, axis=0)
        along = ((edge[:, None] - start) * side).sum(axis=-1) / (side**2).sum(axis=-1)
        nearest = start + np.clip(along, 0, 1)[..., None] * side
        distances.append(np.linalg.norm(edge[:, None] - nearest, axis=-1).min(axis=1))
    error_px = rig.calibration.pixels_per_mm * float(np.sqrt(np.mean(np.concatenate(distances) ** 2)))
    print(f"{error_px:.3f} px over {sum(map(len, distances))} points")
    return error_px


if __name__ == "__main__":
    main()
