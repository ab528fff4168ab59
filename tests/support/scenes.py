"""Scene files as text."""

GOOD = """\
scenario = "impact"

[plate]
size = [0.0928, 0.0928, 0.0032]
modules_through_thickness = 6

[material]
youngs_modulus = 3.35e9
poisson_ratio = 0.25
density = 1190.0
fracture_energy = 1034.0
failure_factor = 31.45

[striker]
diameter = 0.0127
mass = 18.49
velocity = 1.065

[clamp]
kind = "rings"
inner_diameter = 0.076
outer_diameter = 0.090

[solver]
duration = 0.010
"""
