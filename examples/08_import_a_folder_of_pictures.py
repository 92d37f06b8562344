"""Make a dataset of a folder of pictures and find the beam's edges; here a virtual camera takes the pictures."""

from pathlib import Path
from tempfile import TemporaryDirectory

import cv2

from eimi_lab.config.calibration import load_calibration
from eimi_lab.config.rig import load_rig
from eimi_lab.config.specimen import load_specimen
from eimi_lab.dataset.importing import import_frames
from eimi_lab.dataset.segmentation import segment
from eimi_lab.virtual.virtual_rig import open_virtual_rig


def main() -> int:
    """How many edge points were found in all."""
    specimen, calibration = load_specimen("type1"), load_calibration("virtual_calibration")
    with TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "frames").mkdir()
        rows = ["frame,current_A"]
        supply, camera, clock, _ = open_virtual_rig(load_rig("virtual"), specimen)
        supply.set_voltage(12.0)
        supply.set_output(True)
        for number, current_A in enumerate((0.0, 0.5, 1.0)):
            supply.set_current(current_A)
            clock.sleep(1.0)
            cv2.imwrite(str(folder / "frames" / f"{number}.png"), camera.grab(1.0).image)
            rows.append(f"{number},{current_A}")
        (folder / "states.csv").write_text("\n".join(rows) + "\n")
        import_frames(folder / "frames", folder / "states.csv", specimen, calibration, folder / "run.h5")
        edges = segment(folder / "run.h5", print)
    return sum(len(found.left.points_mm) + len(found.right.points_mm) for found in edges)


if __name__ == "__main__":
    main()
