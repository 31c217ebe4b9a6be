"""Temperatures of the whole robot at one pose: what the network found, by part."""

# ruff: noqa: N802, N815 - units keep their capitals: K, W, degC
from dataclasses import dataclass

import numpy as np
from scipy.constants import Stefan_Boltzmann

from pouring_robot.io.temperatures import ZERO_CELSIUS_K
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.closed_chain import IndexArray
from pouring_robot.robot.pouring.thermal_properties import ThermalProperties
from pouring_robot.thermal.network.circuit import Circuit, EnergyBalance
from pouring_robot.thermal.network.leg_elements import LegExposure, LegGrid
from pouring_robot.thermal.network.parts import NodeMap


@dataclass(frozen=True, eq=False)
class TemperatureField:
    """Temperatures at a pose, in K inside and °C by property. Leg arrays run over legs 1 to 4.

    Attributes:
        temperatures_K: of every node, shape (n,).
        melt_K, ambient_K: of melt and surroundings.
        nodes: which node is what.
        circuit: the network at this pose.
        grid: elements of a leg.
        exposure: where they are and what they see.
        rotation_fixed_platform_to_disc: shape (3, 3); the disc's axes are the moving platform's.
        volumes_m3: of the cells of the moving and of the fixed platform.
        properties: as used.
    """

    temperatures_K: FloatArray
    melt_K: float
    ambient_K: float
    nodes: NodeMap
    circuit: Circuit
    grid: LegGrid
    exposure: LegExposure
    rotation_fixed_platform_to_disc: FloatArray
    volumes_m3: tuple[FloatArray, FloatArray]
    properties: ThermalProperties

    @property
    def leg_elements_degC(self) -> FloatArray:
        """Every element of the legs, shape (4, N + F): moving rod from the lower joint upwards, then fixed rod."""
        return np.asarray(self.temperatures_K[self.nodes.legs] - ZERO_CELSIUS_K)

    @property
    def between_joints(self) -> FloatArray:
        """How many metres of the way from joint to joint run through each element, shape (4, N + F)."""
        return self.grid.path_weights_m(self.exposure.lengths_m)

    @property
    def leg_degC(self) -> FloatArray:
        """Mean over the way from upper to lower U-joint centre, shape (4,): the one that lengthens the leg."""
        return np.average(self.leg_elements_degC, axis=1, weights=self.between_joints)

    @property
    def platform_degC(self) -> float:
        """Mean of the moving platform's steel, by volume."""
        return self._platform(self.nodes.moving_platform, self.volumes_m3[0])

    @property
    def platform_elements_degC(self) -> FloatArray:
        """Steel of the moving platform's cells, shape (P,)."""
        return np.asarray(self.temperatures_K[self.nodes.moving_platform] - ZERO_CELSIUS_K)

    @property
    def cladding_degC(self) -> FloatArray:
        """Surface of the moving platform's cladding, shape (C,)."""
        return np.asarray(self.temperatures_K[self.nodes.cladding] - ZERO_CELSIUS_K)

    @property
    def fixed_platform_degC(self) -> float:
        """Mean of the fixed platform, by volume."""
        return self._platform(self.nodes.fixed_platform, self.volumes_m3[1])

    @property
    def fixed_platform_elements_degC(self) -> FloatArray:
        """Cells of the fixed platform, shape (Q,)."""
        return np.asarray(self.temperatures_K[self.nodes.fixed_platform] - ZERO_CELSIUS_K)

    def _platform(self, numbers: IndexArray, volumes: FloatArray) -> float:
        return float(np.average(self.temperatures_K[numbers], weights=volumes)) - ZERO_CELSIUS_K

    @property
    def shell_degC(self) -> float:
        """The ladle's steel shell."""
        return float(self.temperatures_K[self.nodes.shell]) - ZERO_CELSIUS_K

    @property
    def balance(self) -> EnergyBalance:
        """Heat flows of the whole network, in W."""
        return self.circuit.balance(self.temperatures_K, self.melt_K, self.ambient_K)

    @property
    def gradient_K_per_m(self) -> FloatArray:
        """Gradient across each leg element, towards its hot side, in the fixed platform; shape (4, N + F, 3).

        The melt heats one side; see :func:`gradient_across_tube`. It settles within minutes and is taken as steady in
        a transient too.
        """
        sections, grid, steel = self.grid.sections, self.grid, self.properties.steel
        sizes = (grid.moving, grid.fixed)
        outer = np.repeat([sections.rod_radius_m, sections.housing_outer_m], sizes)
        inner = np.repeat([0.0, sections.housing_inner_m], sizes)
        temperatures = self.temperatures_K[self.nodes.legs]
        radiates = bool(self.circuit.ambient_radiation.any())
        scale = steel.emissivity.value * Stefan_Boltzmann if radiates else 0.0
        loss = self.properties.ambient.film_coefficient.value + 4.0 * scale * temperatures**3
        source = scale * self.properties.melt.emissivity.value * (self.melt_K**4 - self.ambient_K**4)
        # An element half inside the housing takes half the flux.
        whole = 2.0 * np.pi * outer * np.repeat([grid.moving_step_m, grid.fixed_step_m], sizes)
        flux = source * self.exposure.area_m2 / whole
        per_harmonic = gradient_across_tube(flux, steel.conductivity.value, loss, outer, inner)
        return np.asarray(
            per_harmonic[..., None] * self.exposure.first_harmonic @ self.rotation_fixed_platform_to_disc.T
        )

    @property
    def leg_directions(self) -> FloatArray:
        """Unit vectors from upper to lower U-joint centre, in the fixed platform, shape (4, 3)."""
        return np.asarray(self.exposure.down @ self.rotation_fixed_platform_to_disc.T)

    @property
    def leg_difference_K(self) -> FloatArray:
        """Largest temperature difference from one side of a leg to the other, shape (4,): gradient times diameter."""
        grid = self.grid
        widths = 2.0 * np.repeat([grid.sections.rod_radius_m, grid.sections.housing_outer_m], (grid.moving, grid.fixed))
        across = np.linalg.norm(self.gradient_K_per_m, axis=-1) * widths * (self.between_joints > 0.0)
        return np.asarray(across.max(axis=1))


def gradient_across_tube(
    flux_W_per_m2: FloatArray, conductivity: float, loss: FloatArray, outer_m: FloatArray, inner_m: FloatArray
) -> FloatArray:
    """Return the gradient that bends a tube which absorbs a flux q cos θ on its outside, in K/m.

    With nothing lost inside, the temperature is (a ρ + b/ρ) cos θ, b = a r², and a follows from
    q = k a (1 - r²/R²) + h a (R + r²/R). What bends a beam is the first moment of that over its section,
    a (1 + 2 r²/(R² + r²)).

    Args:
        flux_W_per_m2: q.
        conductivity: k, in W/mK.
        loss: h, film and linearised re-radiation, in W/m²K.
        outer_m: R.
        inner_m: r; zero for a solid rod.
    """
    hollow = (inner_m / outer_m) ** 2
    slope = flux_W_per_m2 / (conductivity * (1.0 - hollow) + loss * outer_m * (1.0 + hollow))
    return np.asarray(slope * (1.0 + 2.0 * hollow / (1.0 + hollow)))
