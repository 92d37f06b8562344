"""Run a protocol with a camera that eimi_lab does not contain: a class of four methods without a base class."""

import time

import numpy as np

import eimi_lab as eimi
from eimi_drivers.interfaces import Frame, Identity


class Eye:
    def __init__(self, source, settings):
        self.number, self.noise = 0, np.random.default_rng(0)

    def identify(self):
        return Identity("eye", "a program that draws", "here")

    def flush(self):
        pass

    def grab(self, timeout_s):
        self.number += 1
        image = np.where(np.abs(np.arange(128) - 64) < 8, 30.0, 200.0) + self.noise.normal(0, 2, (96, 128))
        time.sleep(0.005)
        return Frame(image.astype(np.uint8), self.number, time.monotonic())

    def close(self):
        pass


eimi.CAMERAS["eye"] = Eye
result = eimi.acquire("protocol.toml", "specimen.toml", "rig.toml", "eye.h5").images(3).shape
