"""With the retries of profiles/slurm: what failed by itself is not done again."""

from __future__ import annotations

from tests.integration.study import Study

RETRIES = ("--retries", "2", "--default-resources", "attempt=attempt")


def test_a_case_that_failed_by_itself_is_given_up_at_once(study: Study) -> None:
    (study.folder / "surfaces/a.surf.gii").write_text("no surface")
    result = study.run(*RETRIES)
    output = result.stdout + result.stderr
    assert result.returncode == 1, output
    assert output.count("Trying to restart job") == output.count("not tried again") == 2
    assert study.status()["sub-a_hemi-L"]["reason"].startswith("surfaces/a.surf.gii: truncated or not GIfTI")
    (log,) = (study.logs / "gate/sub-a").glob("*.log")
    assert log.read_text().count(" ERROR ") == 1
    assert not list(study.logs.rglob("sub-b/.*")), "a job that succeeded leaves nothing behind"
