"""A Dask cluster that loses a worker."""

import pytest
from support.members import SCENE

from studies.cluster import main as study


@pytest.mark.slow
def test_a_worker_killed_in_the_middle(tmp_path, capsys):
    """Slow: eight runs, four of them on a Dask cluster of two processes."""
    pytest.importorskip("distributed")
    words = ["--vary", "striker.velocity=3,4,5,6", "--set", "output.image_times=[]"]
    assert study([str(SCENE), str(tmp_path), *words]) == 0
    told = capsys.readouterr().out
    assert "lost, its worker ended" in told
    assert "differences between Dask and local: none" in told
