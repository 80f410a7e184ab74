"""The time step that a body and its contacts allow.

An explicit step dt with damping c is stable while dt^2 times the largest eigenvalue of M^-1 K is below 4 - 2 c dt. That
of the body is measured by power iteration on differences of its forces. That of the contacts is estimated, as new ones
form between two measurements. A contact of stiffness k joins a node with three others by weights that sum to 1. By
Gershgorin's theorem the eigenvalue is at most 4 k / m, for a node of mass m that touches a triangle while one other
node touches one of its own. Contacts of light nodes are softer (`Contact.weight`), so that k / m is the same for all.

The eigenvalues of two matrices add up at most, so the step is that for their sum.
"""

from __future__ import annotations

import numpy as np

from cortet.folding.body import Material
from cortet.folding.contact import Contact
from cortet.folding.kernels import Work, elastic_forces, nodal_forces
from cortet.meshes import FloatArray

#: part of the longest stable step that is taken: power iteration approaches the largest eigenvalue from below
MARGIN = 0.9
#: rounds of power iteration from a random start, and from the mode of a slightly different body
FIRST, NEXT = 30, 2
#: largest displacement by which forces are differentiated; the body has a size of about 1
_SMALL = 1e-7


def longest_step(
    material: Material,
    x: FloatArray,
    work: Work,
    contact: Contact,
    growth: FloatArray,
    *,
    thickening: float = 0.0,
    mode: FloatArray | None = None,
) -> tuple[float, FloatArray]:
    """The longest time step that is stable, with a margin, and the mode of the body's largest eigenvalue.

    Parameters
    ----------
    x : (n, 3), positions
    growth, thickening : as for `kernels.elastic_forces`
    mode : (n, 3), that of the last call for this body; None: a random start
    """
    body, mode = largest_eigenvalue(material, x, work, growth, thickening=thickening, mode=mode)
    value = body + largest_of_contacts(contact, material, work.node_grown)
    damping = material.damping / material.density
    return MARGIN * (float(np.sqrt(damping**2 + 4 * value)) - damping) / value, mode


def largest_eigenvalue(
    material: Material,
    x: FloatArray,
    work: Work,
    growth: FloatArray,
    *,
    thickening: float = 0.0,
    mode: FloatArray | None = None,
) -> tuple[float, FloatArray]:
    """The largest eigenvalue of M^-1 K of a body without contacts, and its mode; see `longest_step`."""
    rounds = NEXT if mode is not None else FIRST
    if mode is None:
        mode = np.random.default_rng(0).normal(size=x.shape)
    elastic_forces(material, x, work, growth, thickening)
    root, forces = np.sqrt(material.density * work.node_grown)[:, None], nodal_forces(work)
    value = 0.0
    for _ in range(rounds):
        mode = mode / np.sqrt((mode**2).sum())
        way = mode / root
        small = _SMALL / float(np.abs(way).max())
        elastic_forces(material, x + small * way, work, growth, thickening)
        pulled = (forces - nodal_forces(work)) / (small * root)
        value, mode = float((mode * pulled).sum()), pulled
    return value, mode


def largest_of_contacts(contact: Contact, material: Material, volumes: FloatArray) -> float:
    """The largest eigenvalue of M^-1 K of contacts, if each node touches a triangle and one other node touches its own.

    Parameters
    ----------
    volumes : (n,), around each node
    """
    own = volumes[contact.nodes]
    touching = 4 * contact.strength / contact.reach + (contact.stiffness if contact.side else 0.0)
    enveloped = contact.softness if len(contact.planes) else 0.0
    return (touching / (own / contact.weight[contact.nodes]).min() + enveloped / own.min()) / material.density
