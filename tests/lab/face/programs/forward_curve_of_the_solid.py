"""Compute the rotation of the tip at each field with a solid and with a planar model of the same beam."""

from dataclasses import replace

from eimi_fitting import Beam, Loads, Magnet, Specimen

solid = Specimen(30.0, 3.0, 5.0, 1070.0, "solid", Magnet(4.0, 3.0, 2.0, 1.2, 7500.0))
loads = Loads.along([0.0, 2.0, 4.0])
result = [
    Beam(replace(solid, section=section), 12).solve("neo-hookean", [46e3], loads).tip_angle_deg
    for section in ("solid", "plane-stress")
]
