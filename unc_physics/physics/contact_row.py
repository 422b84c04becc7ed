"""What is known of a contact, in one row of numbers."""

#: Columns of a contact's row. Of each direction, normal and two tangents, there are `AXIS` columns: the
#: direction (world axes) and its moment about body i's centre of mass, the same of body j, then the
#: velocities, linear and angular, that an impulse of 1 N s along it gives body i, and takes from body j. Each
#: of these four is eight columns wide, of which two stay 0, as bodies' velocities are: they are read at once.
AXIS, DIRECTION, MOMENT_I, DIRECTION_J, MOMENT_J = 32, 0, 3, 8, 11
PUSH_I, TURN_I, PUSH_J, TURN_J = 16, 19, 24, 27
#: Inverse masses, own compliances along the normal and across, gap, predicted change of the gap beyond the
#: velocities', the gap's acceleration in free fall, reduced radius, friction, restitution, the force of the
#: last step (normal, two tangents), normal speed at the start, damping time, normal speed that an impact
#: shall leave, what a normal impulse asks of both tangential ones. Then what the solver makes of these: the
#: depth that a contact at rest would have, the time that a speed adds to it, two factors of the law. At last
#: the velocity of the partner's surface along both tangents, beyond that of the partner itself.
INVERSE_MASS_I, INVERSE_MASS_J, COMPLIANCE, SLIP_COMPLIANCE, GAP, BEND, FALL = range(96, 103)
RADIUS, FRICTION, RESTITUTION, FORCE, START_SPEED, DAMPING_TIME, TARGET = 103, 104, 105, 106, 109, 110, 111
COUPLING, DEPTH, WAY, GROWTH, STRENGTH, DRIFT = 112, 114, 115, 116, 117, 118
ROW = 120
#: Columns of what opposes a contact's spin about its normal: the most moment over the normal force [m], what
#: it changes the spin by, and the angular velocities that it gives both bodies; each for 1 N m s.
REACH, SPIN_COMPLIANCE, SPIN_I, SPIN_J = 0, 1, 2, 5
TWIST = 8
