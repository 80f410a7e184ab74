"""Meshes with a known fault: none passes a command that can know it, and the certificate names the check that fails."""

from __future__ import annotations

import pytest
from wrong_meshes import COMMANDS, is_seen, sound, wrong_meshes

from cortet.measure.certify import certify

MESHES = {wrong.fault: wrong for wrong in (sound(4), *wrong_meshes(4))}


@pytest.mark.parametrize("wrong", MESHES.values(), ids=MESHES)
def test_a_fault_is_found(wrong, tmp_path):
    for command in COMMANDS:
        seen = wrong.fault != "none" and command not in wrong.unseen_by
        assert is_seen(wrong, command, tmp_path) == seen, f"{command}; is it blind no more?"
    if wrong.check:
        certificate = certify(wrong.mesh, wrong.surface, cell_size=wrong.cell_size)
        assert wrong.check in {check.id for check in certificate.checks if not check.passed}
