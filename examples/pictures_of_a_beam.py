"""Write simulated pictures of a silicone beam for the tutorials, and print the load in each picture.

    python examples/pictures_of_a_beam.py FOLDER            # hanging in a coil, with a magnet at its tip
    python examples/pictures_of_a_beam.py FOLDER --weights  # horizontal, with weights at its tip, without a coil

The beam is simulated as a solid with a shear modulus of 46 kPa. The pictures show the beam, a clamp and a scale of
20 mm in front of a cloth. With --weights, the pictures show the beam in perspective. They then contain the focal length
of the lens, like the pictures of a phone.
"""

import argparse
from pathlib import Path

import cv2
import numpy as np
from PIL import Image
from PIL.ExifTags import IFD, Base

from eimi_fitting import Beam, Loads, Magnet, Specimen
from eimi_fitting.beam.view import View
from eimi_lab.virtual.raster import coverage

SIZE, PIXELS_PER_MM = (1100, 900), 20.0
MODULUS_PA = 46e3
STAND_OFF_MM = 300.0
MAGNET = Magnet(length_mm=4.0, width_mm=3.0, depth_mm=2.0, remanence_T=1.2, density_kg_m3=7500.0)


def picture(outline_px: np.ndarray, clamp_px: np.ndarray, seed: int) -> np.ndarray:
    """Return a picture of the beam, its clamp and a scale of 20 mm in front of a cloth.

    Parameters
    ----------
    outline_px, clamp_px : np.ndarray, shape (n, 2)
        The corners of the beam and of the clamp, px: x to the right, y down. Each array has its own n.
    seed : int
        The seed of the noise.

    Returns
    -------
    np.ndarray, shape (height, width, 3), uint8
        The picture with the colours blue, green and red.
    """
    rng = np.random.default_rng(seed)
    image = np.full((SIZE[1], SIZE[0], 3), [150.0, 140.0, 60.0]) + rng.normal(0, 3, (SIZE[1], SIZE[0], 1))
    left, right = 59.5, 59.5 + 20 * PIXELS_PER_MM
    bar = np.array([[left, 839.5], [right, 839.5], [right, 851.5], [left, 851.5]])
    for shape, colour in ((bar, 20.0), (outline_px, [170.0, 180.0, 235.0]), (clamp_px, 40.0)):
        image += coverage(shape, SIZE)[..., None] * (np.array(colour) - image)
    image = cv2.GaussianBlur(image, (0, 0), 1.0) + rng.normal(0, 1.5, image.shape)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def write(path: Path, image: np.ndarray, in_perspective: bool) -> None:
    """Write a picture to a file.

    Parameters
    ----------
    path : Path
        The file.
    image : np.ndarray, shape (height, width, 3)
        The picture with the colours blue, green and red.
    in_perspective : bool
        True to store the focal length of a camera at the distance `STAND_OFF_MM` in the file.
    """
    exif = Image.Exif()
    exif[Base.Make] = "simulated"
    if in_perspective:  # 43.27 mm is the diagonal of a frame of 36 x 24 mm
        exif.get_ifd(IFD.Exif)[Base.FocalLengthIn35mmFilm] = round(
            STAND_OFF_MM * PIXELS_PER_MM * 43.27 / np.hypot(*SIZE)
        )
    Image.fromarray(image[..., ::-1]).save(path, exif=exif, compress_level=1)  # the noise hardly compresses


def main(folder: Path, weights: bool) -> None:
    """Write four pictures to a folder: of a beam with weights at its tip, or of a beam in the field of a coil."""
    folder.mkdir(parents=True, exist_ok=True)
    specimen = Specimen(30.0, 3.0, 5.0, 1070.0, "solid", None if weights else MAGNET)
    steps = np.array([0.0, 0.5, 1.0, 1.5])  # grams or amperes
    along, clamp = (np.array([1.0, 0.0]), [150.0, 300.0]) if weights else (np.array([0.0, 1.0]), [550.0, 80.0])
    across = np.array([0.0, 1.0]) if weights else np.array([1.0, 0.0])
    if weights:
        loads = Loads.along(np.zeros(4), gravity_angle_deg=90.0, tip_force_N=9.81e-3 * steps)
    else:
        loads = Loads.along(4.7 * steps)
    bent = Beam(specimen, along=16, across=1).solve("neo-hookean", [MODULUS_PA], loads)
    to_px = PIXELS_PER_MM * np.stack([along, across])
    plate = clamp + np.array([[0.0, -7.0], [0.0, 7.0], [-4.0, 7.0], [-4.0, -7.0]]) @ to_px
    lens = View((0.5 * (np.array(SIZE) - 1) - clamp) / PIXELS_PER_MM, STAND_OFF_MM) if weights else None
    for number, (left, right) in enumerate(bent.edges(view=lens)):
        outline_px = clamp + np.concatenate([left, right[::-1]]) @ to_px
        write(folder / f"beam_{number}.png", picture(outline_px, plate, number), weights)
        print(f"{folder}/beam_{number}.png: {steps[number]:g} {'g' if weights else 'A'}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--weights", action="store_true")
    options = parser.parse_args()
    main(options.folder, options.weights)
