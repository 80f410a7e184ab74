"""Meshes with a known fault: none passes a command that can know it, and each refusal is a sentence, no traceback."""

from __future__ import annotations

import pytest
from wrong_meshes import COMMANDS, findings, sound, wrong_meshes

from cortet.measure.certify import certify

MESHES = {wrong.fault: wrong for wrong in (sound(4), *wrong_meshes(4))}


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("wrong", MESHES.values(), ids=MESHES)
def test_a_fault_is_found(wrong, command, tmp_path):
    found = findings(wrong, command, tmp_path)
    if wrong.fault == "none" or command in wrong.unseen_by:
        assert found == [], "a command that sees no surface cannot know it: is it blind no more?"
    else:
        assert found and "Traceback" not in " ".join(found)


@pytest.mark.parametrize("wrong", [wrong for wrong in MESHES.values() if wrong.check], ids=lambda wrong: wrong.fault)
def test_the_certificate_names_the_check_that_fails(wrong):
    certificate = certify(wrong.mesh, wrong.surface, cell_size=wrong.cell_size)
    assert wrong.check in {check.id for check in certificate.checks if not check.passed}
