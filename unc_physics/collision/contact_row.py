"""Columns of a contact's row."""

#: Columns of the normal and of each tangent; direction d begins at column ``AXIS * d``.
#: DIRECTION, MOMENT_I: direction (world axes), and its moment about body i's centre of mass.
#: DIRECTION_J, MOMENT_J: the same for body j.
#: PUSH_I, TURN_I: linear and angular velocity change of body i per impulse of 1 N s.
#: PUSH_J, TURN_J: the same for body j, which are subtracted.
#: Each line is eight columns wide, like bodies' velocities, to be read at once; two columns stay 0.
AXIS, DIRECTION, MOMENT_I, DIRECTION_J, MOMENT_J = 32, 0, 3, 8, 11
PUSH_I, TURN_I, PUSH_J, TURN_J = 16, 19, 24, 27
#: Other columns.
#: INVERSE_MASS_I, INVERSE_MASS_J: 1/kg; 0 for a body that does not move freely.
#: COMPLIANCE, SLIP_COMPLIANCE: velocity change per impulse along the normal, and along the tangents [1/kg].
#: GAP: [m]. FIRST: 1 for the first contact of a patch. FALL: acceleration of the gap in free fall [m/s^2].
#: RADIUS: reduced radius [m]. FRICTION, RESTITUTION: coefficients.
#: FORCE: force of the last step, normal and two tangents [N].
#: LEAD: row of the contact whose normal speed damps this one (`implicit_solver.find_leads`).
#: DAMPING_TIME: [s]. TARGET: normal speed after an impact [m/s].
#: COUPLING: coupling of the normal impulse with both tangential ones.
#: DEPTH: depth at zero normal speed [m]. EFFECTIVE_TIME: change of depth per normal speed [s].
#: QUADRATIC_GAIN, IMPULSE_SCALE: factors of `contact_model.balanced_impulse`.
#: DRIFT: velocity of the partner's surface relative to the partner, along both tangents [m/s].
#: ROLL_RADIUS: radius of a body that rolls, at most [m].
#: IN_MIDDLE: 1 if the impulse acts at its place in the middle of the interval, else 0. PLACES: three places
#: of a rolling body [m] (`middle_arms.rolling_places`). ROLLING: part of the normal speed that comes from
#: rolling, for a contact in the middle [m/s]. ANCHOR: sphere for which the places were found. LEAST: least
#: height of spheres near it [m].
INVERSE_MASS_I, INVERSE_MASS_J, COMPLIANCE, SLIP_COMPLIANCE, GAP, FIRST, FALL = range(96, 103)
RADIUS, FRICTION, RESTITUTION, FORCE, LEAD, DAMPING_TIME, TARGET = 103, 104, 105, 106, 109, 110, 111
COUPLING, DEPTH, EFFECTIVE_TIME, QUADRATIC_GAIN, IMPULSE_SCALE, DRIFT, ROLL_RADIUS = (
    112,
    114,
    115,
    116,
    117,
    118,
    120,
)
IN_MIDDLE, PLACES, ROLLING, ANCHOR, LEAST = 121, 122, 125, 126, 127
ROW = 128
#: Columns of torsional friction.
#: REACH: largest moment per normal force [m]. SPIN_COMPLIANCE: change of spin per moment of 1 N m s.
#: SPIN_I, SPIN_J: changes of both bodies' angular velocities per moment of 1 N m s.
REACH, SPIN_COMPLIANCE, SPIN_I, SPIN_J = 0, 1, 2, 5
TORSION_ROW = 8
