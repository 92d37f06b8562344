"""Measure the error of the dynamic modulus from rendered phone videos of a flicked strip.

    python -m benchmarks.flick [--scenes 20] [--first 0] [--share 1] [--difficulties] [-o FOLDER]
    python -m benchmarks.flick --film flick.mp4 [--seconds 2.4]

The table shows the error of the modulus, the half-width of its 95 % interval, whether the interval contains the true
modulus, and the error due to the typed dimensions ("of sizes"). The goal is that every error is below 5 %.

--first         The seed of the first scene.
--share         The size of the frames, as a share of 1280 x 720 px.
--difficulties  Film one scene several times, each time with one difficulty, such as a phone that is held in the hand.
--film          Only write the video of the first scene, --seconds long.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import os
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import eimi_lab as eimi
from eimi_lab.config.specimen import Beam, SpecimenFile
from eimi_lab.config.toml import to_toml
from tests.shared.phone_films import SIGMAS, PhoneFilm, clicked_line, drawn_film, typed_sizes

LARGEST_ERROR_PERCENT = 5.0


@dataclass(frozen=True)
class Outcome:
    """The fit of one video.

    Attributes
    ----------
    hidden_Pa, fitted_Pa : float
        True and fitted dynamic shear modulus, Pa.
    of_sizes_percent : float
        Error of the modulus due to the typed dimensions, %.
    interval_95 : tuple of float
        95 % interval of the fitted modulus, Pa.
    frequency_error_percent : float
        Error of the frequency, %.
    hidden_loss, fitted_loss : float
        True and fitted loss factor.
    flicks, frames : int
        Numbers of detected flicks and of frames.
    import_s, fit_s : float
        Processor times of the import and of the fit, s.
    messages : str
        Messages of the import.
    doubts : tuple of str
        Warnings of the fit.
    """

    hidden_Pa: float
    fitted_Pa: float
    of_sizes_percent: float
    interval_95: tuple[float, float]
    frequency_error_percent: float
    hidden_loss: float
    fitted_loss: float
    flicks: int
    frames: int
    import_s: float
    fit_s: float
    messages: str
    doubts: tuple[str, ...]

    @property
    def error_percent(self) -> float:
        return 100.0 * (self.fitted_Pa / self.hidden_Pa - 1.0)

    @property
    def holds(self) -> bool:
        return self.interval_95[0] <= self.hidden_Pa <= self.interval_95[1]

    @property
    def in_words(self) -> str:
        half = 50.0 * (self.interval_95[1] - self.interval_95[0]) / self.fitted_Pa
        moduli = f"{self.hidden_Pa / 1e3:10.2f}  {self.fitted_Pa / 1e3:10.2f}  {self.error_percent:7.2f}  {half:12.2f}"
        losses = f"{self.hidden_loss:6.4f}  {self.fitted_loss:6.4f}"
        speed = f"{1e3 * self.import_s / self.frames:10.1f}  {self.fit_s:5.1f}"
        held = "yes" if self.holds else "NO"
        parts = f"{self.of_sizes_percent:10.2f}  {self.frequency_error_percent:9.3f}"
        return f"{moduli}  {held:5}  {parts}  {losses}  {self.flicks:6d}  {speed}"


HEAD = (
    "hidden kPa  fitted kPa  error %  half-width %  holds  of sizes %  f error %    loss  fitted  flicks  ms a frame  "
    "fit s"
)


def outcome(film: PhoneFilm, folder: Path, *, rate: float | None = None) -> Outcome:
    """Render a phone video of a flicked silicone strip into a folder, and fit the strip's modulus to the video.

    `rate` is the frame rate (Hz) that the user types; None for the rate in the video file.
    """
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng([film.seed, 5])
    beam = Beam(name="strip", material="silicone", **typed_sizes(film, rng))
    strip = SpecimenFile(specimen=beam, uncertainty=SIGMAS)
    (folder / "strip.toml").write_text(to_toml(strip))
    video = folder / "flick.mp4"
    if not video.exists():
        film.write(video)
    clicks = clicked_line(film, rng)
    messages = io.StringIO()
    began = time.process_time()
    with contextlib.redirect_stderr(messages):
        dataset = eimi.import_motion(
            video, folder / "strip.toml", folder / "flick.h5", along=clicks, rate=rate, force=True
        )
    import_s, began = time.process_time() - began, time.process_time()
    with dataset:
        flicks = len(dataset.ring_downs())
    fit = eimi.fit(folder / "flick.h5", "neo-hookean", time="prony")
    law = fit.time
    assert law is not None
    assert law.dynamic_shear_modulus.interval_95 is not None
    true = film.strip.specimen
    of_sizes = (beam.length_mm / true.length_mm) ** 4 * (float(true.width_mm) / beam.width_mm) ** 2
    return Outcome(
        film.strip.dynamic_Pa,
        law.dynamic_shear_modulus.value,
        100.0 * (of_sizes * beam.density_kg_m3 / true.density_kg_m3 - 1.0),
        law.dynamic_shear_modulus.interval_95,
        100.0 * (law.frequency_Hz / film.strip.frequency_Hz - 1.0),
        film.strip.loss_factor,
        law.loss_factor,
        flicks,
        len(film.times_s),
        import_s,
        time.process_time() - began,
        messages.getvalue().strip(),
        law.doubts,
    )


def difficulties(film: PhoneFilm) -> Iterator[tuple[str, PhoneFilm, float | None]]:
    """Yield recordings of one strip with one difficulty each: its name, the recording, and the typed frame rate (Hz).

    The frame rate is None if the rate in the video file is used.
    """
    base = replace(film, rate_Hz=240.0, row_time_s=0.6 / 240.0 / film.scene.size[1])
    size = film.flicks_mm[0]
    yield "as the others", base, None
    yield "held by hand, 4 px", replace(base, shake_px=4.0), None
    yield "phone slides by 25 px", replace(base, drift_px=25.0), None
    yield "3 % of the frames lost", replace(base, lost=0.03), None
    yield "slow motion, rate in the file", replace(base, played_Hz=30.0), None
    yield "slow motion, rate stated", replace(base, played_Hz=30.0, is_stated=False), 240.0
    yield (
        "30 frames a second",
        replace(base, rate_Hz=30.0, row_time_s=0.6 / 30.0 / film.scene.size[1], seconds=4.0),
        None,
    )
    yield "three flicks", replace(base, seconds=4.5, flicks_mm=(size, 0.7 * size, 1.2 * size),
                                  released_s=(0.4, 1.9, 3.3)), None  # fmt: skip
    yield "flick out of the picture", replace(base, flicks_mm=(0.30 * film.strip.specimen.length_mm,)), None
    yield "phone upside down", replace(base, turn_deg=180), None
    yield "exposure of 1/120 s", replace(base, rate_Hz=120.0, exposure_s=1 / 125), None
    yield "strong compression", replace(base, quality=25), None


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=int, default=20)
    parser.add_argument("--first", type=int, default=0, help="seed of the first scene")
    parser.add_argument("--difficulties", action="store_true", help="film the first scene with difficulties")
    parser.add_argument("-o", "--output", type=Path, help="folder that keeps videos and files")
    parser.add_argument("--share", type=float, default=1.0, help="size of the frames, as a share of 1280 x 720 px")
    parser.add_argument("--film", type=Path, help="write the video of the first scene to this file, and stop")
    parser.add_argument("--seconds", type=float, default=2.4, help="duration of each video")
    options = parser.parse_args()
    if options.film:
        film = replace(drawn_film(options.first, options.share), seconds=options.seconds)
        film.write(options.film)
        print(f"{options.film}: {len(film.times_s)} frames; hidden dynamic modulus {film.strip.dynamic_Pa:.0f} Pa")
        return
    outcomes = []
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.output or Path(temporary)
        films: Iterator[tuple[str, PhoneFilm, float | None]]
        if options.difficulties:
            films = difficulties(drawn_film(options.first, options.share))
        else:
            seeds = range(options.first, options.first + options.scenes)
            films = ((str(k), replace(drawn_film(k, options.share), seconds=options.seconds), None) for k in seeds)
        print(f"{'scene':32}  {HEAD}")
        count = 0
        for name, film, rate in films:
            count += 1
            try:
                result = outcome(film, folder / name.replace(" ", "_").replace("/", "_"), rate=rate)
            except eimi.InputError as error:
                print(f"{name:32}  refused: {error}", flush=True)
                continue
            outcomes.append(result)
            print(f"{name:32}  {result.in_words}", flush=True)
            if options.difficulties:
                for line in (*result.messages.splitlines(), *(f"doubt: {doubt}" for doubt in result.doubts)):
                    print(f"    {line}")
    errors = np.abs([one.error_percent for one in outcomes])
    print(
        f"errors: median {np.median(errors):.2f} %, largest {errors.max():.2f} %, "
        f"{int((errors < LARGEST_ERROR_PERCENT).sum())} of {count} below {LARGEST_ERROR_PERCENT:g} %; "
        f"{sum(one.holds for one in outcomes)} of {count} intervals hold the hidden modulus; "
        f"load {os.getloadavg()[0]:.1f} at the end"
    )


if __name__ == "__main__":
    main()
