"""Import a folder of pictures and find the edges of the beam. Here a virtual camera takes the pictures."""

from pathlib import Path
from tempfile import TemporaryDirectory

import cv2

import eimi_lab as eimi


def main() -> int:
    """Return the number of edge points in all pictures."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "frames").mkdir()
        rows = ["frame,current_A"]
        with eimi.acquire("dragon_skin_10_quick", "type1", "virtual", folder / "taken.h5") as taken:
            for state in taken.states[:3]:
                cv2.imwrite(str(folder / "frames" / f"{state.index}.png"), taken.images(state.index, most=1)[0])
                rows.append(f"{state.index},{state.current_A}")
        (folder / "states.csv").write_text("\n".join(rows) + "\n")
        tables = folder / "states.csv", "type1", "virtual_calibration"
        with eimi.segment(eimi.import_pictures(folder / "frames", *tables, folder / "run.h5")) as run:
            points = sum(len(edges.left.points_mm) + len(edges.right.points_mm) for edges in run.edges() or ())
    print(f"{points} points")
    return points


if __name__ == "__main__":
    main()
