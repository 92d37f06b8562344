"""The finite-element models of the beam: compute its bent shapes from a specimen, a hyperelastic law and loads.

bending        `Beam`, the public model for every section
specimen       the beam and its magnet
rest_shape     the stress-free shape of a beam that is not a straight strip
rest_modes     smooth deviations from the rest shape
strip          the map from a straight reference beam to the shape at rest
loads          the loads in a sequence of load states: a sum of kinds of load
actuation      the interface of one kind of load
kinds_of_load  a field, gravity, a force at the tip, a pressure
coil_field     the non-uniform field of a coil, and its loads on a magnet and on silicone
model          `BeamModel`, the planar finite-element model
grid           the planar mesh of a specimen
mesh           structured meshes of quadrilaterals
element        the planar element Q2/P1
pressure       pressure on a face that follows the deformation
solid_model    `SolidModel`, the model in three dimensions
solid_grid     the solid mesh of a specimen
bricks         structured meshes of hexahedra
brick          the solid element with 27 nodes
isotropy       stress and tangent of an isotropic law at many points
beside         `SolidBeside`, the solid model, solved quickly with the help of the planar model
depth_effect   the difference between the shapes of the solid and of the planar model
rigid          the magnet as a rigid body
equilibrium    Newton's method for many sets of parameters at once
system         the linear system of a Newton step
band           band matrices of many linear systems
path           equilibria under a sequence of loads, one after another or all at once
inertia        masses of the silicone and of the magnet
transient      the motion of the beam in time, with inertia and viscoelasticity
vibration      small vibrations about an equilibrium: modes, stiffness and mass
modal_motion   frequencies and complex rates of vibrations that are sums of a few modes
twist          the twist by a magnet whose moment has a component normal to the plane
outline        the edges that a camera sees
view           the perspective of a camera
"""
