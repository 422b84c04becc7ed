"""Columns of a contact's row."""

#: There are `AXIS` columns for each direction: normal and two tangents. They hold the direction (world axes)
#: and its moment about body i's centre of mass, then the same for body j. Next are the linear and angular
#: velocity changes of body i per impulse of 1 N s, and of body j, which are subtracted. Each of these four
#: blocks is eight columns wide, like bodies' velocities, to be read at once; two columns stay 0.
AXIS, DIRECTION, MOMENT_I, DIRECTION_J, MOMENT_J = 32, 0, 3, 8, 11
PUSH_I, TURN_I, PUSH_J, TURN_J = 16, 19, 24, 27
#: Inverse masses, compliances along the normal and tangents, gap, 1 for the first contact of a patch. The
#: gap's acceleration in free fall, reduced radius, friction, restitution, force of the last step (normal, two
#: tangents). The row whose normal speed damps the contact (`implicit_solver.find_leads`), damping time,
#: normal speed after an impact, coupling of the normal impulse with both tangential ones. Then the solver's
#: numbers: depth at zero normal speed, its change per speed, and two factors of the law. Velocity of the
#: partner's surface relative to the partner, along both tangents. Distance within which contacts of a patch
#: roll together [m]. A flag, and the shift of the contact in the middle of the interval if the flag is 1
#: (`middle_arms`).
INVERSE_MASS_I, INVERSE_MASS_J, COMPLIANCE, SLIP_COMPLIANCE, GAP, FIRST, FALL = range(96, 103)
RADIUS, FRICTION, RESTITUTION, FORCE, LEAD, DAMPING_TIME, TARGET = 103, 104, 105, 106, 109, 110, 111
COUPLING, DEPTH, WAY, GROWTH, STRENGTH, DRIFT, ROLL_REACH = 112, 114, 115, 116, 117, 118, 120
IN_MIDDLE, SHIFT = 121, 122
ROW = 128
#: Contacts of a patch roll together within the half width of a cylinder's contact at this depth [m]. The
#: cylinder has the body's radius.
ROLL_DEPTH = 2e-4
#: Columns of torsional friction: largest moment per normal force [m], change of spin per moment of 1 N m s,
#: and changes of both bodies' angular velocities.
REACH, SPIN_COMPLIANCE, SPIN_I, SPIN_J = 0, 1, 2, 5
TWIST = 8
