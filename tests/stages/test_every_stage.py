"""What every stage promises: the same bits again, an input that stays as it was, a plain report, no nonsense."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, replace

import numpy as np
import pytest
from pydantic import ValidationError
from test_versions import RESULTS

from cortet.config import Config, load
from cortet.errors import CortetError
from cortet.meshes import TetMesh, TriSurface
from cortet.stages import STAGES, settled
from cortet.stages.stage import About

EXAMPLES = {name: example for name, example in RESULTS.items() if name.split()[0] in STAGES}
#: those that look at the orientation of what they are given
OPTIMISERS = ("clean", "reconnect", "smooth_boundary", "solver_ready")


def arrays(of: TriSurface | TetMesh) -> Iterator[np.ndarray]:
    yield of.points
    yield of.cells if isinstance(of, TetMesh) else of.faces
    yield from of.point_data.values()


def bits(of: TriSurface | TetMesh) -> list[bytes]:
    return [array.tobytes() for array in arrays(of)]


def test_every_stage_has_an_example():
    assert {name.split()[0] for name in EXAMPLES} | {"separate"} == STAGES.keys()


@pytest.mark.parametrize("example", EXAMPLES.values(), ids=EXAMPLES)
def test_a_stage_is_a_function_of_its_input_which_it_leaves_alone(example):
    given = example.given()
    before = [bits(one) for one in given]
    for one in given:
        for array in arrays(one):
            array.setflags(write=False)
    first, report = example.run(*given)
    again, same_report = example.run(*given)
    assert bits(first) == bits(again)
    assert json.dumps(asdict(report), allow_nan=False) == json.dumps(asdict(same_report), allow_nan=False)
    assert [bits(one) for one in given] == before


@pytest.mark.parametrize("name", OPTIMISERS)
def test_a_stage_refuses_inverted_tetrahedra(name):
    mesh, *others = EXAMPLES[name].given()
    inverted = replace(mesh, cells=mesh.cells[:, [1, 0, 2, 3]])
    with pytest.raises(CortetError):
        EXAMPLES[name].run(inverted, *others)


@pytest.mark.parametrize(
    ("stage", "key"),
    [
        (name, key)
        for name, stage in STAGES.items()
        for key in type(stage.section_of(Config())).model_fields
        if name != "solver_ready" and key not in ("template", "size_field")  # any word may be a file's name
    ],
)
def test_a_key_of_a_stage_refuses_nonsense(stage, key):
    section = type(STAGES[stage].section_of(Config()))
    for nonsense in ("nonsense", float("nan"), -1):
        with pytest.raises(ValidationError, match=key):
            section(**{key: nonsense})


@pytest.mark.parametrize(("mesher", "has_it"), [("lattice", False), ("tetgen", False), ("cgal", True)])
def test_a_record_has_only_what_its_mesher_uses(mesher, has_it):
    """Installing pygalmesh, which the lattice mesher does not use, made finished meshes unfinished."""
    record = STAGES["generate"].record(settled(load({})), About(cell_size=1.0, mesher=mesher))
    assert ("backend" in record) is ("facet_angle" in record) is has_it and record["cell_size"] == 1.0
