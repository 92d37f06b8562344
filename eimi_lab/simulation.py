"""Simulating a specimen of a known law through a protocol: what `eimi simulate` writes."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.actuation import Loads
from eimi_fitting.forward import BeamModel, Shapes
from eimi_fitting.materials import LAWS, Law
from eimi_fitting.observation import edge_curves, points_on
from eimi_fitting.solid import Status
from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.errors import InputError
from eimi_lab.outputs import write_whole

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Simulation:
    """One specimen through K states. field_mT: (K,); shapes as the forward model gives them."""

    model: BeamModel
    shapes: Shapes
    field_mT: Array

    @property
    def edges_mm(self) -> Array:
        """(K, 2, n, 2): left and right edge, clamp to tip."""
        return points_on(edge_curves(self.model, self.shapes)[0], 4)


def parse_parameters(model: str, texts: Sequence[str]) -> tuple[Law, Array]:
    """A law and its parameters from texts such as ``mu_Pa=46390``. Raises InputError."""
    if model not in LAWS:
        raise InputError(f"--model {model}: should be one of {', '.join(LAWS)}")
    law = LAWS[model]
    keys = [f"{n}_Pa" if u == "Pa" else n for n, u in zip(law.parameter_names, law.units, strict=True)]
    given: dict[str, float] = {}
    for text in texts:
        key, _, value = text.partition("=")
        try:
            given[key.strip()] = float(value)
            finite = np.isfinite(given[key.strip()])
        except ValueError:
            finite = False
        if not finite:
            raise InputError(f"--parameter {text}: should be KEY=NUMBER, KEY one of {', '.join(keys)}")
    if set(given) != set(keys) or len(texts) != len(keys):
        raise InputError(f"--parameter: {model} takes {', '.join(keys)}, each once; got {', '.join(texts) or 'none'}")
    return law, np.array([given[key] for key in keys])


def simulate(
    specimen: SpecimenFile,
    law: Law,
    parameters: Array,
    field_mT: Array,
    gravity_angle_deg: float,
    field_angle_deg: float = 90.0,
    bulk_modulus_kPa: float | None = None,
) -> Simulation:
    """Take a specimen through the fields (K,), angles in the beam frame; incompressible without a bulk modulus.

    Raises InputError for a bulk modulus in plane stress, for angles or fields that are not finite, for a law that is
    not stiff at rest, and naming the first state without an equilibrium.
    """
    if bulk_modulus_kPa is not None and specimen.specimen.section == "plane-stress":
        raise InputError(
            f"--bulk-modulus-kPa {bulk_modulus_kPa:g}: plane stress is incompressible here; "
            f"specimen {specimen.specimen.name} would have to be plane-strain"
        )
    if bulk_modulus_kPa is not None and not 0 < bulk_modulus_kPa < np.inf:
        raise InputError(
            f"--bulk-modulus-kPa {bulk_modulus_kPa:g}: should be greater than 0, or left out where incompressible"
        )
    for option, values in (("gravity-angle", gravity_angle_deg), ("field-angle", field_angle_deg)):
        if not np.isfinite(values):
            raise InputError(f"--{option} {values:g}: should be a finite number of degrees")
    if not np.isfinite(field_mT).all():
        raise InputError(
            "--coil-constant: gives fields that are not finite; it should be a number of mT for each ampere"
        )
    modulus = float(law.initial_shear_modulus(parameters))
    if not modulus > 0:
        raise InputError(f"--parameter: give {law.name} an initial shear modulus of {modulus:g} Pa; should be above 0")
    model = BeamModel(specimen.mechanics(), along=26)
    bulk = None if bulk_modulus_kPa is None else np.array([1e3 * bulk_modulus_kPa])
    loads = Loads.along(field_mT, field_angle_deg, gravity_angle_deg)
    shapes = model.solve(law, parameters[None], loads, bulk_modulus_Pa=bulk)
    failed = np.flatnonzero(shapes.status[0] != Status.CONVERGED)
    if len(failed):
        k = int(failed[0])
        what = Status(int(shapes.status[0, k])).name.lower().replace("_", " ")
        raise InputError(
            f"specimen {specimen.specimen.name}: {law.name} at {field_mT[k]:g} mT: {what}; it should be a stiffer "
            "law or a weaker field (parameters in Pa, --coil-constant in mT/A)"
        )
    return Simulation(model, shapes, field_mT)


def write_simulation(folder: Path, simulation: Simulation) -> None:
    """`tip.csv`, `state_00_left.csv` and `_right.csv`, `state_00.vtu` for ParaView, `shapes.png`.

    Raises OSError that names the file.
    """
    model, shapes = simulation.model, simulation.shapes
    tip = model.positions(shapes, np.array([[model.specimen.length_mm, 0.0]]))[0, :, 0]
    angle, stretch = model.tip_angle_deg(shapes)[0], shapes.max_stretch[0]
    columns = np.column_stack([simulation.field_mT, tip, angle, stretch])
    write_whole(folder / "tip.csv", _csv(columns, "field_mT,x_mm,y_mm,angle_deg,max_stretch"))
    for k, sides in enumerate(simulation.edges_mm):
        for side, points in zip(("left", "right"), sides, strict=True):
            write_whole(folder / f"state_{k:02d}_{side}.csv", _csv(points, "x_mm,y_mm"))
        _write_vtu(folder / f"state_{k:02d}.vtu", simulation, k)
    write_whole(folder / "shapes.png", _drawn(simulation))


def _csv(columns: Array, header: str) -> bytes:
    text = io.BytesIO()
    np.savetxt(text, columns, "%.6f", ",", header=header, comments="")
    return text.getvalue()


# VTK's biquadratic quadrilateral wants corners, then sides, then the middle; ours is numbered across first.
_VTK_ORDER = [0, 6, 8, 2, 3, 7, 5, 1, 4]


def _write_vtu(path: Path, simulation: Simulation, k: int) -> None:
    import meshio

    model, displacement = simulation.model, simulation.shapes.displacement[0, k]
    stretch = model.element_stretch(simulation.shapes)[0, k]
    flat = np.zeros((len(displacement), 1))
    mesh = meshio.Mesh(
        np.hstack([model.mesh.nodes, flat]),
        [("quad9", model.mesh.elements[:, _VTK_ORDER])],
        point_data={"displacement_mm": np.hstack([displacement, flat])},
        cell_data={"largest_stretch": [stretch]},
    )
    try:
        mesh.write(path)  # takes no open file
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from error


def _drawn(simulation: Simulation) -> bytes:
    from matplotlib.collections import PolyCollection
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6, 6), layout="constrained")
    axes = figure.add_subplot()
    model, shapes = simulation.model, simulation.shapes
    stretch = model.element_stretch(shapes)[0]
    outline = model.mesh.elements[:, [0, 3, 6, 7, 8, 5, 2, 1]]
    for k in np.unique(np.linspace(0, len(simulation.field_mT) - 1, 6).round().astype(int)):
        place = model.mesh.nodes + shapes.displacement[0, k]
        # The beam hangs: x of the beam frame points down.
        patches = PolyCollection(list(np.stack([place[outline, 1], -place[outline, 0]], axis=-1)), cmap="viridis")
        patches.set_array(stretch[k])
        patches.set_clim(1.0, float(stretch.max()))
        axes.add_collection(patches)
        left, right = simulation.edges_mm[k]
        around = np.concatenate([left, right[::-1]])
        axes.plot(around[:, 1], -around[:, 0], color="#333333", linewidth=0.6)
    figure.colorbar(patches, ax=axes, label="largest stretch in the element", shrink=0.6)
    axes.set_aspect("equal")
    axes.set_xlabel("y across, mm")
    axes.set_ylabel("−x along, mm")
    image = io.BytesIO()
    figure.savefig(image, dpi=110)
    return image.getvalue()
