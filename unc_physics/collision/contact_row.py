"""What is known of a contact, in one row of numbers."""

#: Columns of a contact's row. Of each direction, normal and two tangents, there are `AXIS` columns: the
#: direction (world axes) and its moment about body i's centre of mass, the same of body j, then the
#: velocities, linear and angular, that an impulse of 1 N s along it gives body i, and takes from body j. Each
#: of these four is eight columns wide, of which two stay 0, as bodies' velocities are: they are read at once.
AXIS, DIRECTION, MOMENT_I, DIRECTION_J, MOMENT_J = 32, 0, 3, 8, 11
PUSH_I, TURN_I, PUSH_J, TURN_J = 16, 19, 24, 27
#: Inverse masses, own compliances along the normal and across, gap, 1 for the first contact of a patch, the
#: gap's acceleration in free fall, reduced radius, friction, restitution, the force of the last step (normal,
#: two tangents), the row whose normal speed damps the contact (`implicit_solver.find_leads`), damping time,
#: normal speed that an impact shall leave, what a normal impulse asks of both tangential ones. Then the
#: solver's numbers: depth at zero normal speed, the time by which a speed changes it, two factors of the law,
#: the velocity of the partner's surface along both tangents, beyond that of the partner itself. Then the
#: distance within which contacts of a patch roll together [m], and how far away in the middle of the interval
#: the contact pushes, after a 1, or a 0 where it pushes where it is (`middle_arms`).
INVERSE_MASS_I, INVERSE_MASS_J, COMPLIANCE, SLIP_COMPLIANCE, GAP, FIRST, FALL = range(96, 103)
RADIUS, FRICTION, RESTITUTION, FORCE, LEAD, DAMPING_TIME, TARGET = 103, 104, 105, 106, 109, 110, 111
COUPLING, DEPTH, WAY, GROWTH, STRENGTH, DRIFT, ROLL_REACH = 112, 114, 115, 116, 117, 118, 120
IN_MIDDLE, SHIFT = 121, 122
ROW = 128
#: Contacts of a patch roll together within the half width of the contact of a cylinder of the body's radius,
#: this deep [m].
ROLL_DEPTH = 2e-4
#: Columns of what opposes a contact's spin about its normal: the most moment over the normal force [m], what
#: it changes the spin by, and the angular velocities that it gives both bodies; each for 1 N m s.
REACH, SPIN_COMPLIANCE, SPIN_I, SPIN_J = 0, 1, 2, 5
TWIST = 8
