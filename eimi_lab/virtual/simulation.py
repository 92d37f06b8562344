"""The shapes of a specimen with a known law in the fields of a protocol, and the files that `eimi simulate` writes."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.beside import SolidBeside
from eimi_fitting.beam.equilibrium import Status
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.mesh import Indices
from eimi_fitting.beam.model import BeamModel, Shapes
from eimi_fitting.beam.outline import outline, points_on
from eimi_fitting.beam.strip import Strip
from eimi_fitting.laws import LAWS, Law
from eimi_fitting.suggestion import suggestion
from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.process.errors import InputError
from eimi_lab.process.outputs import whole_folder, write_whole
from eimi_lab.showing.tables import html_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure  # slow to import

Array = NDArray[np.float64]

_ALONG = 26  # number of finite elements along the flexible part of the beam
_FEWEST_CONVERGED = 0.975  # share of the draws: with fewer draws, an end of the 95 % interval is unknown


@dataclass(frozen=True)
class Simulation:
    """The simulated shapes of one specimen in K states (load steps).

    Parameters
    ----------
    model
        The finite-element model of the beam.
    shapes
        The shapes of the beam for one set of parameters in K fields.
    field_mT
        The fields, mT, shape (K,).
    tips
        Lower and upper ends of the 95 % intervals of the tip's x (mm), y (mm) and angle (degrees), shape (K, 3, 2);
        None if the parameters have no uncertainty, NaN in states in which too many random draws of the parameters give
        no equilibrium.
    remarks
        Sentences about the intervals.
    """

    model: BeamModel | SolidBeside
    shapes: Shapes
    field_mT: Array
    tips: Array | None = None
    remarks: tuple[str, ...] = ()

    @property
    def edges_mm(self) -> Array:
        """The left and the right edge in each load step, n points from clamp to tip, mm, shape (K, 2, n, 2)."""
        return points_on(outline(self.model, self.shapes)[0], 4)

    @property
    def tip_mm(self) -> Array:
        """The coordinates x (along the straight beam) and y (across) of the tip in each load step, mm, shape (K, 2)."""
        return _tip(self.model, self.shapes)[0, :, :2]

    @property
    def tip_angle_deg(self) -> Array:
        """The rotation of the tip from +x toward +y in each load step, degrees, shape (K,)."""
        return _tip(self.model, self.shapes)[0, :, 2]

    @property
    def max_stretch(self) -> Array:
        """The largest principal stretch in the beam in each load step, shape (K,)."""
        return np.asarray(self.shapes.max_stretch[0])

    def plot(self) -> Any:
        """Return a matplotlib figure of the beam's shape in up to six load steps, coloured by the stretch."""
        return _drawn(self)

    def write(self, folder: str | Path, force: bool = False) -> Path:
        """Write the files of the simulation into a folder, and return the path of the folder.

        Raises InputError if the folder is not empty, unless ``force`` is true.
        """
        with whole_folder(Path(folder), force) as unfinished:
            write_simulation(unfinished, self)
        return Path(folder)

    def __repr__(self) -> str:
        beam, tip = self.model.specimen, float(self.tip_angle_deg[-1])
        return (
            f"<Simulation as {beam.section}: {len(self.field_mT)} states, the tip at {tip:.2f} degrees in the last "
            "state>"
        )

    def _repr_html_(self) -> str:
        columns = (self.field_mT, *self.tip_mm.T, self.tip_angle_deg, self.max_stretch)
        rows = [[f"{value:.4g}" for value in row] for row in zip(*columns, strict=True)]
        return html_table(repr(self)[1:-1], ("field, mT", "x, mm", "y, mm", "angle, degrees", "stretch"), rows)


def keys_of(law: Law) -> list[str]:
    """Return the names of a law's parameters for the option `--parameter`, such as ``mu_Pa``."""
    return [f"{n}_Pa" if u == "Pa" else n for n, u in zip(law.parameter_names, law.units, strict=True)]


def parse_parameters(model: str, texts: Sequence[str]) -> tuple[Law, Array]:
    """Return the hyperelastic law `model`, and the values of its parameters from the texts of the option `--parameter`.

    Parameters
    ----------
    model
        Name of the law.
    texts
        One text for each parameter, such as ``mu_Pa=46390``.

    Returns
    -------
    law : Law
        The law.
    parameters : ndarray, shape (n,)
        Values of the parameters, moduli in Pa.

    Raises
    ------
    InputError
        If the law is unknown, or if a parameter is missing, unknown or not a number.
    """
    if model not in LAWS:
        raise InputError(f"--model {model}: there is no law {model!r}; {suggestion(model, LAWS)}")
    law = LAWS[model]
    keys = keys_of(law)
    values: dict[str, float] = {}
    for text in texts:
        key, _, value = text.partition("=")
        try:
            values[key.strip()] = float(value)
            finite = np.isfinite(values[key.strip()])
        except ValueError:
            finite = False
        if not finite:
            raise InputError(f"--parameter {text}: should be KEY=NUMBER, where KEY is one of {', '.join(keys)}")
    if set(values) != set(keys) or len(texts) != len(keys):
        raise InputError(
            f"--parameter: {model} has the parameters {', '.join(keys)}, each of which should be given once; given "
            f"are {', '.join(texts) or 'none'}"
        )
    return law, np.array([values[key] for key in keys])


def simulate(
    specimen: SpecimenFile,
    law: Law,
    parameters: Array,
    field_mT: Array,
    gravity_angle_deg: float,
    field_angle_deg: float = 90.0,
    bulk_modulus_kPa: float | None = None,
    drawn: Array | None = None,
) -> Simulation:
    """Compute the shapes of a specimen in K fields.

    Parameters
    ----------
    specimen
        The specimen.
    law
        The hyperelastic law.
    parameters
        Parameters of the law, moduli in Pa, shape (n,).
    field_mT
        The fields, mT, shape (K,).
    gravity_angle_deg, field_angle_deg
        Directions of gravity and of the field in the beam frame (x along the straight beam from the clamp, y across),
        degrees from +x toward +y.
    bulk_modulus_kPa
        Bulk modulus, kPa; None for an incompressible material.
    drawn
        D random draws of the parameters from their uncertainty, shape (D, n), for the 95 % intervals of the tip; None
        for no intervals.

    Returns
    -------
    Simulation
        The shapes in all fields.

    Raises
    ------
    InputError
        If an input cannot be used, or if the beam has no equilibrium in one of the fields.
    """
    if bulk_modulus_kPa is not None and specimen.specimen.section == "plane-stress":
        raise InputError(
            f"--bulk-modulus-kPa {bulk_modulus_kPa:g}: plane stress is computed for incompressible materials only; "
            f"specimen {specimen.specimen.name} should be solid or plane-strain"
        )
    if bulk_modulus_kPa is not None and not 0 < bulk_modulus_kPa < np.inf:
        raise InputError(
            f"--bulk-modulus-kPa {bulk_modulus_kPa:g}: should be greater than 0, or omitted for an incompressible "
            "material"
        )
    for option, values in (("gravity-angle", gravity_angle_deg), ("field-angle", field_angle_deg)):
        if not np.isfinite(values):
            raise InputError(f"--{option} {values:g}: should be an angle in degrees, such as 90")
    if not np.isfinite(field_mT).all():
        raise InputError("--coil-constant: the fields are not finite; the coil constant should be a number in mT/A")
    modulus = float(law.initial_shear_modulus(parameters))
    if not modulus > 0:
        raise InputError(
            f"--parameter: the initial shear modulus of {law.name} is {modulus:g} Pa; it should be above 0"
        )
    beam = specimen.mechanics()
    planar = BeamModel(beam, along=_ALONG, plane=beam.planar_section)
    model = SolidBeside(beam, _ALONG, 2 * planar.across) if beam.section == "solid" else planar
    bulk = None if bulk_modulus_kPa is None else np.array([1e3 * bulk_modulus_kPa])
    loads = Loads.along(field_mT, field_angle_deg, gravity_angle_deg)
    shapes = model.solve(law, parameters[None], loads, bulk_modulus_Pa=bulk)
    failed = np.flatnonzero(shapes.status[0] != Status.CONVERGED)
    if len(failed):
        k = int(failed[0])
        failure = Status(int(shapes.status[0, k])).name.lower().replace("_", " ")
        raise InputError(
            f"specimen {specimen.specimen.name}: {law.name} at {field_mT[k]:g} mT: {failure}; use larger parameters "
            "(in Pa) or a weaker field (--coil-constant in mT/A)"
        )
    tips: Array | None = None
    remarks: tuple[str, ...] = ()
    if drawn is not None and len(drawn):
        bulk_of_draws = np.full(len(drawn) + 1, bulk[0]) if bulk is not None and model is planar else None
        of_draws = planar.solve(law, np.concatenate([parameters[None], drawn]), loads, bulk_modulus_Pa=bulk_of_draws)
        tips = _tip_intervals(planar, of_draws, _tip(model, shapes)[0])
        remarks = _remarks(of_draws, field_mT[np.isnan(tips[:, 0, 0])])
    return Simulation(model, shapes, field_mT, tips, remarks)


def _tip(model: BeamModel | SolidBeside, shapes: Shapes) -> Array:
    """Return x (mm), y (mm), angle (degrees) of the tip for P sets of parameters in K load steps, shape (P, K, 3)."""
    point = np.zeros((1, 2 if isinstance(model, BeamModel) else 3))
    point[:, :2] = Strip(model.specimen).at_rest(np.array([[model.specimen.length_mm, 0.0]]))
    place = model.positions(shapes, point)[:, :, 0, :2]
    return np.concatenate([place, model.tip_angle_deg(shapes)[..., None]], axis=-1)


def _tip_intervals(planar: BeamModel, shapes: Shapes, tip: Array) -> Array:
    """Return the 95 % intervals of the tip's x (mm), y (mm) and angle (degrees) in K load steps, shape (K, 3, 2).

    NaN where the nominal parameters or too many draws have no equilibrium. `shapes` of the planar model: first the
    nominal parameters, then random draws. `tip` (K, 3): nominal x, y and angle.
    """
    values = _tip(planar, shapes)
    values += tip - values[0]
    converged = shapes.status == Status.CONVERGED
    known = converged[0] & (converged[1:].mean(axis=0) >= _FEWEST_CONVERGED)
    intervals = np.full((*tip.shape, 2), np.nan)
    for k in np.flatnonzero(known):
        intervals[k] = np.quantile(values[1:][converged[1:, k], k], [0.025, 0.975], axis=0).T
    return intervals


def _remarks(shapes: Shapes, without_mT: Array) -> tuple[str, ...]:
    """Return a sentence on the fields `without_mT`, in which the tip has no interval; empty if there are none."""
    if not len(without_mT):
        return ()
    failed = int((shapes.status != Status.CONVERGED).sum(axis=0).max())
    fields = ", ".join(f"{field:g}" for field in without_mT)
    return (
        f"no 95 % interval of the tip at {fields} mT: up to {failed} of {len(shapes.status)} simulations with random "
        "parameters have no equilibrium",
    )


def write_simulation(folder: Path, simulation: Simulation) -> None:
    """Write the files of a simulation into a folder.

    Tip: ``tip.csv``. Shapes: ``shapes.png``. For each load step, the edges (``state_00_left.csv``,
    ``state_00_right.csv``) and the solution for ParaView (``state_00.vtu``). An OSError names the file that could not
    be written.
    """
    model, shapes = simulation.model, simulation.shapes
    columns = np.column_stack([simulation.field_mT, _tip(model, shapes)[0], shapes.max_stretch[0]])
    names = "field_mT,x_mm,y_mm,angle_deg,max_stretch"
    if simulation.tips is not None:
        columns = np.column_stack([columns, simulation.tips.reshape(len(columns), 6)])
        names += ",x_low_mm,x_high_mm,y_low_mm,y_high_mm,angle_low_deg,angle_high_deg"
    write_whole(folder / "tip.csv", _csv(columns, names))
    for k, sides in enumerate(simulation.edges_mm):
        for side, points in zip(("left", "right"), sides, strict=True):
            write_whole(folder / f"state_{k:02d}_{side}.csv", _csv(points, "x_mm,y_mm"))
        _write_vtu(folder / f"state_{k:02d}.vtu", simulation, k)
    image = io.BytesIO()
    _drawn(simulation).savefig(image, dpi=110)
    write_whole(folder / "shapes.png", image.getvalue())


def _csv(columns: Array, header: str) -> bytes:
    text = io.BytesIO()
    np.savetxt(text, columns, "%.6f", ",", header=header, comments="")
    return text.getvalue()


# The numbers of an element's nodes in the order of VTK: corners, middles of the sides, centres of the faces, and the
# centre. In this program the nodes of a planar element are numbered across first, and the nodes of a solid element in
# depth first.
_QUADRILATERAL = [0, 6, 8, 2, 3, 7, 5, 1, 4]
_HEXAHEDRON = [0, 18, 24, 6, 2, 20, 26, 8]
_HEXAHEDRON += [9, 21, 15, 3, 11, 23, 17, 5, 1, 19, 25, 7]
_HEXAHEDRON += [4, 22, 10, 16, 12, 14, 13]


def _write_vtu(path: Path, simulation: Simulation, k: int) -> None:
    import meshio

    model, displacement = simulation.model, simulation.shapes.displacement[0, k]
    stretch = model.element_stretch(simulation.shapes)[0, k]
    nodes, elements = model.mesh.nodes, model.mesh.elements
    if isinstance(model, BeamModel):
        flat = np.zeros((len(displacement), 1))
        nodes, displacement = np.hstack([nodes, flat]), np.hstack([displacement, flat])
        cells = ("quad9", elements[:, _QUADRILATERAL])
    else:
        nodes, displacement, elements = _both_halves(nodes, displacement, elements)
        stretch = np.tile(stretch, 2)
        cells = ("hexahedron27", elements[:, _HEXAHEDRON])
    mesh = meshio.Mesh(
        nodes, [cells], point_data={"displacement_mm": displacement}, cell_data={"largest_stretch": [stretch]}
    )
    try:
        mesh.write(path)  # meshio does not accept an open file
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from error


def _both_halves(nodes: Array, displacement: Array, elements: Indices) -> tuple[Array, Array, Indices]:
    """Return nodes, displacements and elements of the whole solid, from the computed half on one side of mid-depth.

    `nodes`, `displacement`: shape (N, 3), mm; the third coordinate is 0 at mid-depth. `elements`: node numbers, (E,
    27).
    """
    mirror, away = np.array([1.0, 1.0, -1.0]), nodes[:, 2] > 0
    image = np.arange(len(nodes))
    image[away] = len(nodes) + np.arange(away.sum())
    turned = image[elements].reshape(-1, 9, 3)[:, :, ::-1].reshape(-1, 27)
    return (
        np.concatenate([nodes, nodes[away] * mirror]),
        np.concatenate([displacement, displacement[away] * mirror]),
        np.concatenate([elements, turned]),
    )


def _seen_from_the_side(model: BeamModel | SolidBeside) -> tuple[Indices, Indices]:
    """Return the numbers of the m elements in a side view, (m,), and of the 8 nodes around each element, (m, 8)."""
    around = np.array([0, 3, 6, 7, 8, 5, 2, 1])
    elements = model.mesh.elements
    if isinstance(model, BeamModel):
        return np.arange(len(elements)), elements[:, around]
    amid = np.flatnonzero(model.mesh.nodes[elements[:, 0], 2] == 0)
    return amid, elements[amid][:, 3 * around]


def _drawn(simulation: Simulation) -> Figure:
    from matplotlib.collections import PolyCollection

    from eimi_lab.showing.drawing import Drawing

    figure = Drawing(6.0, 6.0)
    axes = figure.add_subplot()
    model, shapes = simulation.model, simulation.shapes
    shown, outlines = _seen_from_the_side(model)
    stretch = model.element_stretch(shapes)[0][:, shown]
    for k in np.unique(np.linspace(0, len(simulation.field_mT) - 1, 6).round().astype(int)):
        place = (model.mesh.nodes + shapes.displacement[0, k])[:, :2]
        # The beam is drawn hanging, with x of the beam frame pointing down.
        patches = PolyCollection(list(np.stack([place[outlines, 1], -place[outlines, 0]], axis=-1)), cmap="viridis")
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
    return figure
