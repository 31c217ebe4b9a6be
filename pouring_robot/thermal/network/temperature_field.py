"""The temperatures at a pose, by part, and the gradients that bend the legs."""

from dataclasses import dataclass

import numpy as np

from pouring_robot.io.temperatures import ZERO_CELSIUS_K
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.robot.pouring.names import CHAINS, LEGS
from pouring_robot.robot.pouring.thermal_properties import ThermalProperties
from pouring_robot.thermal.network.bodies import Bodies
from pouring_robot.thermal.network.elements import LegExposure
from pouring_robot.thermal.network.heat_balance import Circuit, EnergyBalance, grey_radiation


@dataclass(frozen=True, eq=False)
class TemperatureField:
    """Temperatures at a pose, stored in K, with properties in °C. Leg arrays run over legs 1 to 4."""

    temperatures_K: FloatArray  # of every node, shape (n,)
    melt_K: float
    ambient_K: float
    bodies: Bodies  # meaning of nodes, elements, materials
    circuit: Circuit  # the network at this pose
    exposure: LegExposure  # positions and view factors of the leg elements
    rotation_fixed_platform_to_disc: FloatArray  # shape (3, 3); the disc's axes are the moving platform's

    @property
    def properties(self) -> ThermalProperties:
        """Thermal properties used."""
        return self.bodies.properties

    @property
    def degC(self) -> FloatArray:
        """Temperature of every node, shape (n,)."""
        return np.asarray(self.temperatures_K - ZERO_CELSIUS_K)

    @property
    def leg_elements_degC(self) -> FloatArray:
        """Temperature of every leg element, (4, N + F): moving rod from the lower joint upwards, then fixed rod."""
        return self.degC[self.bodies.nodes.legs]

    @property
    def between_joints(self) -> FloatArray:
        """Length within each element of the path from joint to joint, shape (4, N + F), in m."""
        return self.bodies.grid.path_weights_m(self.exposure.lengths_m)

    @property
    def leg_degC(self) -> FloatArray:
        """Mean over the path from upper to lower U-joint centre, which determines the expansion of a leg; (4,)."""
        return np.average(self.leg_elements_degC, axis=1, weights=self.between_joints)

    @property
    def mean_degC(self) -> dict[str, float]:
        """Mean temperatures that determine the expansion of legs and both platforms, by part."""
        legs = dict(zip(LEGS, self.leg_degC.tolist(), strict=True))
        return legs | {"platform": self.platform_degC, "fixed_platform": self.fixed_platform_degC}

    @property
    def summary(self) -> str:
        """Temperatures of legs and moving platform, in words."""
        legs = "  ".join(f"{value:.0f}" for value in self.leg_degC)
        return f"legs {CHAINS[0]}-{CHAINS[-1]} {legs}, platform {self.platform_degC:.0f} degC"

    @property
    def platform_degC(self) -> float:
        """Volume mean of the moving platform's steel."""
        return float(np.average(self.platform_elements_degC, weights=self.bodies.moving.volume_m3))

    @property
    def platform_elements_degC(self) -> FloatArray:
        """Temperatures of the steel in the moving platform's cells, shape (P,)."""
        return self.degC[self.bodies.nodes.moving_platform]

    @property
    def cladding_degC(self) -> FloatArray:
        """Surface temperatures of the moving platform's cladding, shape (C,)."""
        return self.degC[self.bodies.nodes.cladding]

    @property
    def fixed_platform_degC(self) -> float:
        """Volume mean of the fixed platform."""
        return float(np.average(self.fixed_platform_elements_degC, weights=self.bodies.fixed.volume_m3))

    @property
    def fixed_platform_elements_degC(self) -> FloatArray:
        """Temperatures of the fixed platform's cells, shape (Q,)."""
        return self.degC[self.bodies.nodes.fixed_platform]

    @property
    def shell_degC(self) -> float:
        """Temperature of the ladle's steel shell."""
        return float(self.degC[self.bodies.nodes.shell])

    @property
    def balance(self) -> EnergyBalance:
        """Heat flows of the whole network, in W."""
        return self.circuit.balance(self.temperatures_K, self.melt_K, self.ambient_K)

    @property
    def gradient_K_per_m(self) -> FloatArray:
        """Gradient across each leg element, towards its hot side, in the fixed platform; shape (4, N + F, 3).

        The melt heats one side; see :func:`gradient_across_tube`. The gradient settles within minutes and is taken as
        steady in transients, too.
        """
        grid, steel = self.bodies.grid, self.properties.steel
        radiates = bool(self.circuit.ambient_radiation.any())
        one, emissivity = np.ones(()), steel.emissivity.value if radiates else 0.0
        to_melt, to_ambient = grey_radiation(one, one, emissivity, self.properties.melt.emissivity.value)
        temperatures = self.temperatures_K[self.bodies.nodes.legs]
        loss = self.properties.ambient.film_coefficient.value + 4.0 * (to_melt + to_ambient) * temperatures**3
        source = to_melt * (self.melt_K**4 - self.ambient_K**4)
        # An element half inside the housing absorbs half the flux.
        flux = source * self.exposure.area_m2 / (2.0 * np.pi * grid.outer_m * grid.step_m)
        per_harmonic = gradient_across_tube(flux, steel.conductivity.value, loss, grid.outer_m, grid.inner_m)
        return np.asarray(
            per_harmonic[..., None] * self.exposure.first_harmonic @ self.rotation_fixed_platform_to_disc.T
        )

    @property
    def leg_directions(self) -> FloatArray:
        """Unit vectors from upper to lower U-joint centre, in the fixed platform, shape (4, 3)."""
        return np.asarray(self.exposure.down @ self.rotation_fixed_platform_to_disc.T)

    @property
    def leg_difference_K(self) -> FloatArray:
        """Largest temperature difference between opposite sides of a leg, on its surface, shape (4,).

        For a solid rod it is the gradient times the diameter, for a tube 2 a (R + r²/R), with a from
        :func:`gradient_across_tube`: less than the bending gradient times the diameter.
        """
        grid = self.bodies.grid
        hollow = (grid.inner_m / grid.outer_m) ** 2
        wide = 2.0 * grid.outer_m * (1.0 + hollow) ** 2 / (1.0 + 3.0 * hollow)
        across = np.linalg.norm(self.gradient_K_per_m, axis=-1) * wide
        return np.asarray((across * (self.between_joints > 0.0)).max(axis=1))


def gradient_across_tube(
    flux_W_per_m2: FloatArray, conductivity: float, loss: FloatArray, outer_m: FloatArray, inner_m: FloatArray
) -> FloatArray:
    """Return the gradient that bends a tube which absorbs a flux q cos θ on its outside, in K/m.

    Without losses inside, the temperature is (a ρ + b/ρ) cos θ, b = a r², and a follows from q = k a (1 - r²/R²) + h a
    (R + r²/R). A beam is bent by the first moment of that over its section, a (1 + 2 r²/(R² + r²)). k is the
    conductivity, in W/mK, h the loss by film and linearised re-radiation, in W/m²K, R and r are the radii; r is zero
    for a solid rod.
    """
    hollow = (inner_m / outer_m) ** 2
    slope = flux_W_per_m2 / (conductivity * (1.0 - hollow) + loss * outer_m * (1.0 + hollow))
    return np.asarray(slope * (1.0 + 2.0 * hollow / (1.0 + hollow)))
