"""How far MJX and Warp may be from C: the limits of `yes`, `close` and `NO`, each with its source.

Errors of states are relative to the largest entry of a field where that exceeds 1; errors of
accelerations are relative to what constraints do (docs/method/accelerated.md has both, and what
follows from each limit). "Measured" is the largest value among the engines whose answer is `yes` or
`close` in results/judgements.json: 26 pairs of a model and an engine in float32, 3 in float64.
Some were judged when `SOLUTION_LIMIT` was 1e-4; none of their solutions is beyond that. A
limit that is "chosen" has no other source than what is said. Planted faults have to be beyond the
limits, and C itself within them (`tests/commands/compare/test_accelerated_agreement.py`).
"""

from mjbench.simulation.accelerated_judgement import Precision

# --- smooth dynamics

# Error of one step on which no constraint acts. Measured: 1e-15 and 1.2e-5.
SMOOTH_LIMIT = {Precision.FLOAT64: 1e-12, Precision.FLOAT32: 1e-4}
# Error of an unconstrained run in float64. Measured: 5e-16. In float32 `SHADOW_FACTOR` holds.
UNCONSTRAINED_RUN_LIMIT = 1e-10
# Share of the steps that change a state in C and none in the engine. Measured: 0. Chosen: a half.
STILL_LIMIT = 0.5

# --- contacts

# Effect on accelerations of the contacts of one pair of types, in the state where it is largest:
# `yes` within it. Chosen.
CONTACT_LIMIT = {Precision.FLOAT64: 1e-6, Precision.FLOAT32: 1e-4}
# Types of geoms whose contacts have a closed form with one answer; of all others, engines choose
# points of a surface where bodies touch, each in its own way.
ONE_ANSWER = frozenset(
    {("plane", "sphere"), ("plane", "capsule"), ("sphere", "sphere"), ("sphere", "capsule")}
)
# In each state where the axes of friction are C's, they change accelerations by less than this, or
# by less than the limit of `yes` where rounding raises that, else `NO`: an engine's formula may
# divide by a length that it keeps from zero. Chosen.
ONE_ANSWER_EFFECT = 1e-3
# In nine of ten states, contacts whose points or axes of friction an engine chooses in its own way
# change accelerations by less than this: `close`, else `NO`. Chosen. Measured: 0.08, of Warp on the
# ant of gymnasium-robotics.
CLOSE_EFFECT, CLOSE_QUANTILE = 0.1, 0.9
# In each state whose contacts are C's own, but for some that are missing, accelerations change by
# less than this, else `NO`: a choice of other points would be seen. Chosen.
LACKING_EFFECT = 0.01
# In float32, the largest effect of contacts that agree grows with what rounding does in C, up to
# this, which is below that of a lost contact. Measured: 0.0048.
MAX_ROUNDING_EFFECT = 0.5 * LACKING_EFFECT
# Tangents turned by less than this, in degrees, are the same. Where friction is a pyramid, they are
# its axes, which engines choose. Chosen.
SAME_TANGENT_DEGREES = 0.1
# Contacts this near to each other, relative to the size of the model's parts, are the same. Chosen.
SAME_PLACE = 1e-4
# A contact this near to where it begins to count, relative to the size of coordinates, may count in
# one engine alone. Chosen.
BORDER = {Precision.FLOAT64: 1e-9, Precision.FLOAT32: 1e-5}

# --- the constraint problem

# Error of the solution for the engine's own contacts, and of the forces beside those that follow
# from its accelerations. Measured: 6e-15 and 4.4e-5 for accelerations, 1.1e-14 and 9.7e-4 for
# forces (Warp on gripper, where rounding raises the limit to 0.005). Of engines whose answer is
# `NO` for other reasons: Warp on pile, 5.4e-4. MJX in float32 exceeds it on gripper: 2.1e-3.
SOLUTION_LIMIT = {Precision.FLOAT64: 1e-6, Precision.FLOAT32: 1e-3}
# In float32, an error may also be this many times that of C where its states and contacts are moved
# by rounding: an engine rounds all that it computes. It is at most `MAX_ROUNDING_EFFECT`, but in a
# state where rounding alone does more. Chosen.
ROUNDING_FACTOR = 10.0
# With the user's own settings, an engine may end this many times as far from the solution as C, or
# this far. Measured: 4.4e-5. Chosen.
SETTINGS_FACTOR, SETTINGS_LIMIT = 10.0, 1e-3

# --- the run

# An engine may be this many times as far from C as the shadow, which rounds only states. Chosen.
SHADOW_FACTOR = 10.0
# Differences below these shares of a figure's size are rounding. Chosen in float32: single steps of
# Warp on dm_control's humanoid agree, and forces of its run differ by 0.10 N, where this allows
# 0.64 N (results/judgements.json).
FIGURE_ROUNDING = {Precision.FLOAT64: 1e-8, Precision.FLOAT32: 1e-3}
# The shadow has parted from C where a figure differs by more than this share of its size. Chosen.
TOGETHER_SHARE = 0.01
# Before that, an engine's may differ by no more than this share of its size; after that, and where
# contacts differ, means by this share, besides `MEAN_ERRORS` standard errors of the difference of
# two means. Chosen; of normal errors, 99.7 % are within three.
CLOSE_SHARE, MEAN_ERRORS = 0.1, 3
# Means may differ by no more than this share, however much C's simulations differ: otherwise a
# figure that is zero in the engine could pass. Chosen.
LARGEST_SHARE = 0.9
