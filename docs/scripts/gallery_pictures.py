"""Draw the pictures of the gallery, one for each numbered script in examples/.

    python docs/scripts/gallery_pictures.py

The beams are simulated in plane stress or plane strain, or as solids on a coarse mesh. All ten pictures therefore take
only seconds.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import matplotlib

matplotlib.use("agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

sys.path.insert(0, str(Path(__file__).parents[2]))
from eimi_drivers.clock import SimulatedClock
from eimi_drivers.emulators import CoilSupply, open_in_process
from eimi_drivers.interfaces import Limits
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.outline import edge_curves, points_on
from eimi_fitting.beam.specimen import Magnet, Specimen
from eimi_fitting.inference.planning.sensitivity import edge_sensitivity
from eimi_fitting.laws import LAWS
from eimi_fitting.laws.cards import Material, material_card
from eimi_fitting.laws.tensile import engineering_stress, fit_tensile
from eimi_lab.config.protocol import load_protocol
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.edges.finding import find_edges
from tests.shared.photographs import CALIBRATION, SPECIMEN, photograph
from tests.shared.rendered_edges import errors_px

FOLDER = Path(__file__).parents[1] / "gallery"
BEAM = Specimen(30.0, 3.0, 5.0, 1070.0, "plane-stress", Magnet(4.0, 3.0, 2.0, 1.2, 7500.0))
NEO_HOOKEAN = LAWS["neo-hookean"]


def edges_mm(field_mT: np.ndarray, modulus_Pa: float = 46e3) -> np.ndarray:
    """Return both edges of a Neo-Hookean beam in K fields, mm, shape (K, 2, m, 2).

    The second axis is the left and the right edge, and the third axis the m points of an edge, each with x and y.
    """
    model = BeamModel(BEAM)
    return points_on(
        edge_curves(model, model.solve(NEO_HOOKEAN, np.array([[modulus_Pa]]), Loads.along(field_mT)))[0], 4
    )


def draw_hanging(axes: Axes, edges: np.ndarray, **style: object) -> None:
    """Draw both edges (2, m, 2) of a hanging beam as a camera sees them: y to the right, x down."""
    for edge in edges:
        axes.plot(edge[:, 1], edge[:, 0], **style)  # type: ignore[arg-type]
    axes.set(aspect="equal", xlabel="y, mm", ylabel="x, mm")
    axes.set(xlim=(-8, 24), ylim=(32, -1))


def bend_a_beam(axes: Axes) -> None:
    strip = Specimen(60.0, 3.0, 5.0, 0.0, "plane-stress")
    force_N = np.linspace(0, 4e-4, 9)
    model = BeamModel(strip)
    shapes = model.solve(NEO_HOOKEAN, np.array([[46e3]]), Loads.along(0.0, gravity_angle_deg=90.0, tip_force_N=force_N))
    theory_mm = force_N * 60.0**3 / (3 * 0.138 * 5.0 * 3.0**3 / 12)
    axes.plot(1e6 * force_N, model.positions(shapes, np.array([[60.0, 0.0]]))[0, :, 0, 1], "o", label="finite elements")
    axes.plot(1e6 * force_N, theory_mm, label="F L³ / (3 E I)")
    axes.set(xlabel="force at the tip, µN", ylabel="deflection, mm")
    axes.legend()


def fit_a_virtual_dataset(axes: Axes) -> None:
    for edges in edges_mm(np.linspace(0, 7.05, 6)):
        draw_hanging(axes, edges, color="tab:orange", lw=1)


def fit_tracked_points(axes: Axes) -> None:
    model, rest = BeamModel(BEAM), np.column_stack([np.linspace(5.0, 25.0, 9), np.zeros(9)])
    shapes = model.solve(NEO_HOOKEAN, np.array([[46e3]]), Loads.along([0.0, 2.0, 4.0, 6.0]))
    for field, places in zip((0, 2, 4, 6), model.positions(shapes, rest)[0], strict=True):
        axes.plot(places[:, 1], places[:, 0], "o-", ms=3, label=f"{field} mT")
    axes.set(aspect="equal", xlabel="y, mm", ylabel="x, mm")
    axes.set(xlim=(-8, 24), ylim=(28, 3))
    axes.legend()


def fit_a_tensile_curve(axes: Axes) -> None:
    strain = np.linspace(0.02, 1.0, 50)
    stress = engineering_stress(LAWS["yeoh"], np.array([20e3, 4e3, 200.0]), strain)
    axes.plot(strain, stress / 1e3, "k.", ms=4, label="measured")
    for name, law in LAWS.items():
        axes.plot(
            strain, engineering_stress(law, fit_tensile(law, strain, stress).parameters, strain) / 1e3, label=name
        )
    axes.set(xlabel="engineering strain", ylabel="engineering stress, kPa")
    axes.legend()


def write_a_material_card(axes: Axes) -> None:
    material = Material(NEO_HOOKEAN, np.array([46e3]), 92e6, "dragon_skin_10", ("an example",))
    axes.text(0.02, 0.5, material_card("abaqus", material), family="monospace", fontsize=7, va="center")
    axes.axis("off")


def try_a_protocol_dry(axes: Axes) -> None:
    currents = load_protocol("dragon_skin_10").currents_A
    axes.step(range(len(currents)), currents, where="post")
    axes.set(xlabel="state", ylabel="current, A")


def drive_an_emulated_supply(axes: Axes) -> None:
    clock = SimulatedClock()
    coil = CoilSupply(clock, resistance_ohm=4.0, time_constant_s=0.1, current_noise_A=0.003, seed=1)
    supply = open_in_process("korad", coil, Limits(current_A=1.0, voltage_V=12.0))
    supply.set_voltage(12.0)
    supply.set_current(0.7)
    supply.set_output(True)
    start_s, rows = clock.now(), []
    for _ in range(25):
        rows.append((clock.now() - start_s, supply.measure().current_A))
        clock.sleep(0.02)
    supply.safe_off()
    axes.plot(*zip(*rows, strict=True), "o-", ms=3)
    axes.set(xlabel="s", ylabel="measured current, A")


def import_a_folder_of_pictures(axes: Axes) -> None:
    photo = photograph("shadow beside", np.random.default_rng(4), 50.0)
    axes.imshow(photo.image[..., ::-1])
    edge_set = find_edges(photo.image, CALIBRATION, SPECIMEN)
    for edge in (edge_set.left, edge_set.right):
        axes.plot(*BeamFrame(CALIBRATION).to_px(edge.points_mm).T, "w-", lw=1)
    axes.set(xlim=(350, 950), ylim=(650, 0), xlabel="px", ylabel="px")


def error_of_edges(axes: Axes) -> None:
    photo = photograph("uneven light", np.random.default_rng(4), 50.0)
    edge_set = find_edges(photo.image, CALIBRATION, SPECIMEN)
    for name, errors in zip(("left", "right"), errors_px(edge_set, photo.beam, CALIBRATION), strict=True):
        axes.plot(errors, lw=1, label=name)
    axes.set(xlabel="point, from the clamp to the tip", ylabel="error, px")
    axes.legend()


def what_the_data_fix(axes: Axes) -> None:
    model = BeamModel(Specimen(30.0, 3.0, 5.0, 1070.0, "plane-strain", BEAM.magnet))
    sensitivity = edge_sensitivity(model, LAWS["mooney-rivlin"], np.array([15e3, 8e3]), Loads.along([7.05]))
    for name, slope, style in zip(("C10", "C01"), sensitivity.slope[0, :, 0, 0], ("-", "--"), strict=True):
        axes.plot(sensitivity.edges[0, 0, 0, :, 0], 1e6 * slope[:, 1], style, lw=2, label=name)
    axes.set(xlabel="x, mm", ylabel="move of the left edge, µm/kPa")
    axes.legend()


PICTURES: tuple[Callable[[Axes], None], ...] = (
    bend_a_beam,
    fit_a_virtual_dataset,
    fit_tracked_points,
    fit_a_tensile_curve,
    write_a_material_card,
    try_a_protocol_dry,
    drive_an_emulated_supply,
    import_a_folder_of_pictures,
    error_of_edges,
    what_the_data_fix,
)


def main() -> None:
    FOLDER.mkdir(exist_ok=True)
    for number, draw in enumerate(PICTURES, 1):
        figure, axes = plt.subplots(figsize=(4.2, 3.0), layout="constrained")
        draw(axes)
        figure.savefig(FOLDER / f"{number:02d}_{draw.__name__}.png", dpi=90)
        plt.close(figure)


if __name__ == "__main__":
    main()
