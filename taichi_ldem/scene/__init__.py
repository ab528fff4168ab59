"""Scene files: TOML tables in SI units, read once and checked as a whole."""

from taichi_ldem.scene.bodies import Clamp, Contact, Floor, Grips, Supports
from taichi_ldem.scene.checks import SCENARIOS, ScenarioRules, register_scenario
from taichi_ldem.scene.load import Override
from taichi_ldem.scene.loads import Load, Probe, Start
from taichi_ldem.scene.messages import NATURAL
from taichi_ldem.scene.names import LAW_NAMES, NOSE_NAMES
from taichi_ldem.scene.scene import (
    TABLES,
    Scene,
    key_for,
    load_scene,
    load_tables,
    overridden_tables,
    parse_overrides,
    parse_scene,
    parse_scene_text,
    scene_to_toml,
)
from taichi_ldem.scene.specimen import FILES, Hole, Notch, Plate
from taichi_ldem.scene.strikers import MOST_STRIKERS, Striker
from taichi_ldem.scene.tables import (
    DISORDERED,
    LARGEST_CV,
    Disorder,
    Material,
    Modes,
    Output,
    Pulse,
    Solver,
)

__all__ = [
    "DISORDERED",
    "FILES",
    "LARGEST_CV",
    "LAW_NAMES",
    "MOST_STRIKERS",
    "NATURAL",
    "NOSE_NAMES",
    "SCENARIOS",
    "TABLES",
    "Clamp",
    "Contact",
    "Disorder",
    "Floor",
    "Grips",
    "Hole",
    "Load",
    "Material",
    "Modes",
    "Notch",
    "Output",
    "Override",
    "Plate",
    "Probe",
    "Pulse",
    "ScenarioRules",
    "Scene",
    "Solver",
    "Start",
    "Striker",
    "Supports",
    "key_for",
    "load_scene",
    "load_tables",
    "overridden_tables",
    "parse_overrides",
    "parse_scene",
    "parse_scene_text",
    "register_scenario",
    "scene_to_toml",
]
