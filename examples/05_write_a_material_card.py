"""Write a law as a material card for Abaqus."""

import numpy as np

from eimi_fitting import LAWS, Material, material_card


def main() -> float:
    """Return the value of C10 (MPa) in the card."""
    modulus_Pa = 46e3
    material = Material(
        law=LAWS["neo-hookean"],
        parameters=np.array([modulus_Pa]),
        bulk_modulus_Pa=2000 * modulus_Pa,  # bending does not determine it: choose a value that your solver can handle
        name="dragon_skin_10",
        origin=("an example",),
    )
    card = material_card("abaqus", material)
    print(card)
    numbers = next(line for line in card.splitlines() if not line.startswith("*"))
    return float(numbers.split(",")[0])


if __name__ == "__main__":
    main()
