"""Bend a beam by a moment at its tip, a kind of load that eimi_lab does not contain."""

import numpy as np

from eimi_fitting import Beam, Loads, Magnet, Specimen


class TipMoment:
    def __init__(self, numbers):
        self.numbers = numbers  # (K, 1): N mm in each state

    def take(self, states):
        return TipMoment(self.numbers[states])

    def apply(self, numbers, field_factor, mesh, total):
        total.moment[:] += numbers[0] * mesh.share


beam = Beam(Specimen(30.0, 3.0, 5.0, 0.0, "plane-stress", Magnet(4.0, 3.0, 2.0, 1.2, 0.0)))
loads = Loads.along([0.0, 0.0, 0.0], gravity_angle_deg=None).plus(TipMoment(np.array([[0.0], [0.001], [0.002]])))
result = beam.solve("neo-hookean", [46e3], loads).tip_angle_deg
