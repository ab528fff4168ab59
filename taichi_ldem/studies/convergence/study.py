"""Error against run time over resolution, time step and precision: a work-precision study.

The kind of a scene (``run.kind``) decides the reference and the quantities:

- elastic impact: velocity and impulses against those of the finest lattice;
- free vibration: the frequency against that of vanishing modules;
- wave: the displacement at a probe against the exact one;
- cracking impact: times, forces, energies and cracks for several places of the striker.

Each run is a process of its own on one thread, and finished runs are not repeated. Errors are
relative to the reference, and for the order in time to the same lattice with a much smaller step.
"""

import importlib.util
from collections.abc import Sequence
from pathlib import Path

from taichi_ldem.errors import SceneError
from taichi_ldem.scene import load_scene
from taichi_ldem.storage.folder import RunFolder
from taichi_ldem.studies.convergence import cracking
from taichi_ldem.studies.convergence.figure import figure
from taichi_ldem.studies.convergence.plan import PLANS
from taichi_ldem.studies.convergence.records import Study
from taichi_ldem.studies.convergence.report import report, write_csv
from taichi_ldem.studies.convergence.run import CRACKING, VIBRATION, kind


def run(
    scene_file: Path,
    out: Path,
    *,
    modules: Sequence[int] = (),
    reference: int | None = None,
    seeds: int = 4,
    force: bool = False,
) -> int:
    """Run what is missing and write ``convergence.csv``, ``.md`` and ``.png``; returns 0.

    Args:
        modules: through the thickness, instead of the plan's.
        reference: modules of the reference, instead of the plan's.
        seeds: number of places of the striker for a cracking scene.
        force: remove the runs of another scene.

    Raises:
        SceneError: the scene is of no kind that is studied, or the folder holds the runs of
            another scene.
    """
    scene = load_scene(scene_file)
    what = kind(scene)
    if what == VIBRATION and scene.held and importlib.util.find_spec("skfem") is None:
        raise SceneError("a clamped plate is compared with finite elements: install scikit-fem")
    study = Study(scene_file, scene, what, out, PLANS[what], modules, reference)
    with RunFolder.held(out):
        study.claim(force)
        return cracking.run(study, seeds) if what == CRACKING else _against_reference(study)


def _against_reference(study: Study) -> int:
    """Run what is missing and report it."""
    study.run_all()
    rows = study.rows()
    write_csv(rows, study.out / "convergence.csv")
    text = report(study, rows)
    (study.out / "convergence.md").write_text(text, encoding="utf-8")
    figure(study, rows, study.out / "convergence.png")
    print(text)
    return 0
