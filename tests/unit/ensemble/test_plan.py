"""The members of an ensemble: which there are, how they are named, and what is refused."""

import pytest
from support.members import SCENE, SPEEDS

from taichi_ldem.ensemble.plan import (
    RECORD,
    make_plan,
    read_plan,
    refuse_other_plan,
    write_plan,
)
from taichi_ldem.errors import SceneError


def names(**options) -> list[str]:
    return [member.name for member in make_plan(SCENE, **options).members]


def test_full_product_with_readable_names():
    assert names(vary=["striker.velocity=2,2.50", "striker.mass=0.04,5e-2"]) == [
        "velocity2_mass0.04",
        "velocity2_mass0.05",
        "velocity2.5_mass0.04",
        "velocity2.5_mass0.05",
    ]


def test_cv_by_seeds():
    plan = make_plan(SCENE, cv="0.10,0.5", seeds="3:5", vary=["disorder.density_cv=0.2"])
    assert [member.name for member in plan.members] == [
        f"cv{cv}_density_cv0.2_seed{seed}" for cv in ("0.1", "0.5") for seed in (3, 4)
    ]
    disorder = plan.members[-1].scene.disorder
    assert disorder is not None
    assert (disorder.fracture_energy_cv, disorder.density_cv, disorder.seed) == (0.5, 0.2, 4)
    assert plan.members[0].group == plan.members[1].group != plan.members[2].group


def test_no_variability_is_one_homogeneous_member_whatever_the_seeds():
    plan = make_plan(SCENE, cv="0,0.25", seeds="0:3")
    assert [m.name for m in plan.members] == ["cv0", *(f"cv0.25_seed{n}" for n in range(3))]
    assert plan.members[0].scene.disorder is None
    assert plan.members[0].varied == {"disorder.fracture_energy_cv": 0.0, "disorder.seed": None}


def test_no_variability_of_the_fracture_energy_beside_another_that_draws():
    vary = ["disorder.youngs_modulus_cv=0,0.1"]
    found = names(cv="0", seeds="0:2", vary=vary)
    assert found == ["cv0", "cv0_youngs_modulus_cv0.1_seed0", "cv0_youngs_modulus_cv0.1_seed1"]


def test_the_seed_is_that_of_perturbed_nodes_too():
    vary = ["plate.perturbation=0,0.05"]
    plan = make_plan(SCENE, cv="0,0.25", seeds="3:5", vary=vary)
    found = {member.name: member.scene for member in plan.members}
    assert list(found) == [
        "cv0_perturbation0",
        "cv0_perturbation0.05_seed3",
        "cv0_perturbation0.05_seed4",
        *(f"cv0.25_perturbation{p}_seed{n}" for p in ("0", "0.05") for n in (3, 4)),
    ]
    nodes = found["cv0_perturbation0.05_seed4"]
    assert (nodes.disorder, nodes.plate.perturbation_seed) == (None, 4)
    both = found["cv0.25_perturbation0.05_seed4"]
    assert both.disorder is not None
    assert (both.disorder.seed, both.plate.perturbation_seed) == (4, 4)
    alone = make_plan(SCENE, seeds="3:5", settings=["plate.perturbation=0.05"])
    assert [m.scene.plate.perturbation_seed for m in alone.members] == [3, 4]
    held = ["plate.perturbation=0.05", "plate.perturbation_seed=9"]
    kept = make_plan(SCENE, cv="0.25", seeds="3:5", settings=held)
    assert [m.scene.plate.perturbation_seed for m in kept.members] == [9, 9]


def test_values_with_commas_and_keys_of_one_last_word():
    vary = ["striker.position=[0.0,0.0],[1e-3,0.0]", "plate.size=[0.0192,0.0192,0.0016]"]
    assert names(vary=vary) == [
        "position0.0x0.0_size0.0192x0.0192x0.0016",
        "position1e-3x0.0_size0.0192x0.0192x0.0016",
    ]
    vary = ["striker.diameter=0.006,0.007", "plate.diameter=0.01"]
    with pytest.raises(SceneError, match="diameter"):
        names(vary=vary)


def test_settings_are_for_all_members():
    plan = make_plan(SCENE, vary=[SPEEDS], settings=["striker.mass=0.03"])
    assert {member.scene.striker.mass for member in plan.members} == {0.03}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "nothing is varied: give --cv, --seeds or --vary"),
        ({"cv": "0.1,x"}, "--cv 0.1,x: must be numbers of at least 0"),
        ({"cv": "-0.1"}, "--cv -0.1: must be numbers of at least 0"),
        ({"cv": "nan"}, "--cv nan: must be numbers of at least 0"),
        ({"cv": "0.1,0.10"}, "--cv 0.1,0.10: 0.1 is given twice"),
        ({"cv": "2", "seeds": "0:2"}, "fracture_energy_cv = 2.0: must be at most 1.5"),
        ({"cv": "0.1", "seeds": "4:4"}, "--seeds 4:4: must be whole numbers"),
        ({"cv": "0.1", "seeds": "-1"}, "--seeds -1: must be whole numbers"),
        ({"cv": "0.1", "seeds": "0:999999999"}, "must be at most 100000 seeds"),
        (
            {"vary": ["striker.velocity"]},
            "--vary striker.velocity: must have the form section.key=value",
        ),
        ({"vary": ["striker.velocity=1,,2"]}, "a value is missing"),
        ({"vary": ["striker.speed=1,2"]}, "unknown key 'striker.speed'"),
        ({"vary": ["striker.velocity=1", "striker.velocity=2"]}, "the key is varied twice"),
        ({"vary": ["striker.velocity=-1,2"]}, "striker.velocity = -1"),
        ({"vary": ["solver.threads=1,2"]}, "members 'threads1' and 'threads2' are the same run"),
    ],
)
def test_what_cannot_be_is_one_line(options, message):
    with pytest.raises(SceneError) as error:
        make_plan(SCENE, **options)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_the_record_reads_back_and_another_ensemble_is_refused(plan, tmp_path):
    write_plan(plan, tmp_path, threads=2)
    again = read_plan(tmp_path)
    assert [m.name for m in again.members] == [m.name for m in plan.members]
    assert [m.varied for m in again.members] == [m.varied for m in plan.members]
    assert again.members[0].scene.solver.threads == 2
    assert again.hash == plan.hash  # threads change no result
    refuse_other_plan(plan, tmp_path)
    # another version may know more keys of a scene, which gives another hash
    record = tmp_path / RECORD
    written = record.read_text()
    record.write_text(written.replace(plan.hash, "0" * 64))
    refuse_other_plan(plan, tmp_path)
    record.write_text(written)
    for other, difference in (
        (make_plan(SCENE, vary=["striker.velocity=2,2.5"]), "only there: velocity3"),
        (make_plan(SCENE, vary=["striker.velocity=2,2.5,3,4"]), "only asked for: velocity4"),
        (
            make_plan(SCENE, vary=[SPEEDS], settings=["striker.mass=0.05"]),
            "striker.mass = 0.04 there, 0.05 asked for (velocity2)",
        ),
    ):
        with pytest.raises(SceneError, match="holds another ensemble: ") as error:
            refuse_other_plan(other, tmp_path)
        assert difference in str(error.value)
