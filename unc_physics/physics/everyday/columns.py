"""Columns of the arrays that the step's kernels share, and its tuned numbers.

What kernels share is in few two-dimensional arrays of floats with named columns, because each array argument
of a compiled function costs time at every call:

``Y``
    Bodies, one a row: the scene's bodies, then what is fixed: the ground, of all elements of the environment
    that do not tilt, and a row for each one that does. `shapes` takes its first columns as frames.
``pieces``, ``rows``
    Convex pieces, with their points and faces, as in `shapes.columns`. ``spots`` holds what a step adds.
``C``
    Contacts that may act within the step. ``par`` holds settings, ``count`` what is counted.
"""

# ---- bodies
FRAME, ROT = 0, 3  # origin of the pieces' axes in the world; rotation matrix, row by row
STATE = 12  # of the centre of mass, as in `spatial.layout`:
CENTRE, VEL, QUAT, SPIN = 12, 15, 18, 22
IWORLD = 25  # inverse inertia in world axes: xx, yy, zz, xy, xz, yz
MOVED, TURNED, TILTED = 31, 34, 37  # since the search; TILTED is TURNED without the spin about AXIS
IMASS, INERTIA, IBODY = 40, 41, 47  # inverse mass, 0 unless it moves freely; inertia, its inverse; body axes
STEADY = 53  # 1 where the angular velocity stays without torque: inertia of a ball, or no gyroscopic term
RADIUS, MIDDLE, HALF = 54, 55, 58  # of all pieces: sphere about the centre of mass; box in their axes
FIRST, LAST = 61, 62  # rows of the pieces; the last is exclusive
TRAVEL, REACH = 63, 64  # way of the farthest point so far, and the most in this step [m]
SURGE = 65  # most change of velocity of a point in this step without contacts [m/s]
QUIET = 66  # time at rest [s]
DRIVEN = 67  # 1 where the velocities are given in this step: on a path, or attached
ACCEL = 68  # acceleration by gravity and forces [m/s^2]
PUSH_V, PUSH_W = 71, 74  # velocities that only take out depth
FREE_W = 77  # change of the angular velocity with time without torque
AXIS, ARM = 80, 83  # of its lathes: direction, and the axis' nearest point to the centre of mass; body axes
ARM_BEFORE = 86  # ARM in world axes at the search
ROLLS = 89  # 1 where there is such an axis
OFFSET = 90  # centre of mass in the pieces' axes
OWN_IMASS = 93  # inverse mass when it moves freely
WAY = 94  # of the farthest point in the last step [m]
SHOVE = 95  # most change of velocity in this step by bodies that may strike it [m/s]
BODY = 96

# ---- what a step adds to a piece
WHERE = 0  # centre of its bounding sphere in the world
SURFACE_OF = 3  # number of its material: its body's, or B + e of element e
ON_AXIS = 4  # 1 for a lathe about its body's AXIS
SOME = 5  # scratch: a list of pieces
SPOT = 6

# ---- contacts; a is the body with the smaller number, except that one that does not move freely is a
# what is remembered between steps, and what callers read
GAP0 = 0  # at the search
LEVER_A, LEVER_B = 1, 4  # then, from the centres of mass to the cores; of LATHE ones from their axis
WARM, WARM_MOMENT = 7, 10  # forces along normal and tangents to start from; moments about these
BODY_A, BODY_B, PIECE_A, PIECE_B = 13, 14, 15, 16
FACE_OF = 17  # whose face the other body's point touches, and with which the normal turns: 1 a, 2 b, 0 none
RIM_A, RIM_B = 18, 19  # whether it is the lathe's farthest point, which travels along the rim as it tilts
SINCE = 20  # ways of both bodies' farthest points since its search [m]
POINT, IMPULSE = 21, 24  # middle of the gap, after a step; impulse on b of the whole step; world axes
POINTED, EDGE = 27, 28  # 1 between corners or edges; direction of the edge, if any, at the search: b's at 2
LATHE_A, LATHE_B = 31, 32  # whether turns about AXIS move it
MODE = 33  # see `solve.sweep`; of rows of the step before: whether used
MU0 = 34  # friction in sliding
WENT = 35  # ways of both bodies' farthest points in the step before [m]
CURVES = 36  # change of the normal with b's way along EDGE, and across it, over a hollow surface [1/m]
NORMAL = 38  # from a to b
REMEMBERED = 41
# what a step adds; the tangents follow the normal
TAN1, TAN2 = 41, 44
GAP, REBOUND = 47, 48  # now; wanted normal speed after an impact
LN, L1, L2 = 49, 50, 51  # impulses along normal and tangents
MASS_N, MASS_T, K11, K12, K22 = 52, 53, 54, 55, 56  # effective masses: normal, least and 2 x 2 tangential
MU, E = 57, 58  # friction now; restitution
TWIST, ROLL = 59, 60  # most moment about and across the normal per normal force [m]
BELT_U, SURFACE_U = 61, 64  # speeds along normal and tangents to reach: a belt's, and with what turns add
ARM_A, ARM_B = 67, 70  # from the centres of mass to where impulses act
BY_NORMAL = 73  # speeds along both tangents by a unit impulse along the normal
BEFORE = 75  # impulses before a sweep; the first also those of `solve.push_out`
MOMENT = 78  # impulses of moments about normal and tangents
RHO_A, RHO_B = 81, 82  # roundings
SAVED = 83  # normal and tangents while an impact's error turns them
SURFACE_A, SURFACE_B = 92, 93  # numbers of materials: a body's, or B + e of element e
STRUCK = 94  # impacts in this step
BEND = 95  # acceleration of the gap by turns, where it changes the gap in a substep [m/s^2]
EASE_N, EASE_T = 96, 97  # spin by a unit moment about the normal, and the sum for the tangents
ROLL_SPEED = 98  # speed of a point at the contact's lever by a unit moment about a tangent
BELT_W = 99  # angular velocity of a's surface as a belt [rad/s]
FIRST_NORMAL = 102  # NORMAL at the search
GAP_NOW = 105  # without what GAP adds for the rest of the substep
COLS = 106

# ---- pairs of bodies
CLEAR = 0  # no contact before the bodies' TRAVEL adds up to this
ROW0, ROWS = 1, 2  # contacts in the rows of the step before
PARTED = 3  # of bodies of one piece: the direction that parted them last
PAIR = 6

# ---- a list of pieces of a pair of bodies that may come near soon: row 0, then the other rows
L_KEY, L_NUMBER, L_HOLDS = 0, 1, 2  # which pair, number of rows, TRAVEL up to which it holds
L_A, L_B, L_CLEAR, L_PARTED = 0, 1, 2, 3  # pieces, TRAVEL before which they are apart, what parted them last
LIST = 6

# ---- pairs of pieces of a pair of bodies that are near
N_GAP, N_A, N_B, N_NORMAL, N_P, N_Q = 0, 1, 2, 3, 6, 9  # gap, pieces, normal, nearest points
N_HOW = 12  # first whether in contact the step before; then where the normal is from: see below
N_ENTRY, N_REACH = 13, 14  # row in the list (later whether it stands for its normal), gap that matters now
N_ORDER = 15  # scratch of sorting
NEARS = 16
OWN, FACES, OTHERS = 0, 1, 2  # nearest points; faces, whose contacts are written; another pair's normal

# ---- groups of bodies that touch, rows of an array of integers
PARENT, GROUP, NEXT, START, MEMBERS = 0, 1, 2, 3, 4
GROUPS = 5

# ---- settings
GRAVITY, DECAY, SLEEP = 0, 3, 4  # in the world [m/s^2]; rate of damping [1/s]; whether groups at rest sleep
DIRECTION_ERROR, POINT_ERROR, MU_ERROR = 5, 6, 7  # of impacts: standard deviations [rad], [m], of a logarithm
SLIPPERINESS = 8  # inverse of the closing speed at which friction of impacts is half [s/m]
STEP_NUMBER, PART = 9, 10  # number of the present step, and which part of it
SETTINGS = 11

# ---- materials, rows of an array with a column for each body and element, then for each pair of its own
FRICTION, RESTITUTION = 0, 1
TORSION, ROLLING = 2, 3  # moments per normal force [m]; TORSION is below 0 if not given
PAIR_A, PAIR_B = 4, 5  # the last columns are of pairs, and have their numbers here; -1 in the others
MATERIALS = 6

# ---- what is counted
(CONTACTS, VISITS, SEARCHES, CUT, IMPACTS, IMPACT_VISITS, DIRECTS, SETTLED) = range(8)
COUNTS = 8

# ---- tuned numbers
SUBSTEPS = 2  # of a step, else one; with one, Euler's disc loses 4 degrees in 1 s, elastic boxes 12 % energy
TURN = 3e-2  # rad, turn of a body within a step from which its group has these: elastic cans lose energy else
LONGEST = 5e-3  # s, step from which all have these: with one, stacks of ratio 100 shift by 6 mm at 1/120 s
SWEEPS = 30  # most rounds of impulses; laws hold from 10 on
TOLERANCE = 3e-5  # m/s, change of a contact's speed that ends sweeps: with 5e-5 a box in a grip creeps 9 um
BOUNCE = 0.1  # m/s, closing speed from which what is not elastic rebounds: measured for metal and plastic
BETWEEN = 4  # sweeps from one extrapolation to the next; the first change more than what converges slowly
FARTHEST = 20.0  # most that these add, in last changes: the ratio of changes is uncertain
LONG = 0.3  # share of a whole substep from which its forces start the next; tiny ones tell little
SLOW = 0.03  # m/s, contacts that close slower land without an impact: with .1, rocking blocks lose energy;
# what slides slower stops within 1 mm, and its contacts are chosen as at rest
SLOP = 2e-5  # m, depth that is left so that contacts at rest last, and motion up to which they are kept
NEAR = 2e-4  # m, contacts that take part in an impact: flatness of machined faces
CUTS = 8  # of a step at impacts, shared by the bodies of a group, but at least one; more cost time in piles
IMPACTS_MOST, IMPACT_SWEEPS = 16, 100  # rounds over a group's pairs, and over the contacts of a pair
PUSH, PUSH_MOST = 0.2, 0.1  # share of the depth that a substep takes out, and of error in that; most [m/s]
# m, another contact's normal that parts two pieces up to this replaces their own, and a nearest point that is
GHOST = 1e-4  # nearer than all corners by no more is no contact of its own
STANDS, HELD = 1e-6, 1e-4  # m/s, m/s^2: speed, and acceleration by all forces, of points that stay
SLEEP_AFTER = 0.1  # s at rest after which a group sleeps
ASLEEP = 3e-3  # m/s, speed of a body's fastest point at rest
SLIDES = 1e-4  # m/s, speed at which a contact at rest slides: sweeps leave a third of it
DRIFT = 1e-4  # m, added to what a body can travel within a step: pushes out of depth
MARGIN = 8e-3  # m, reach of a list of pieces beyond what the next step needs: a step at 2 m/s
FEATURE = 1e-6  # m, from a face up to which a point is on it
ON_RIM = 2e-4  # m, from a lathe's farthest point, up to which a contact travels along the rim
SAME_POINT = 0.02  # m, distance up to which a contact takes the forces of one in the step before
RATIO = 30.0  # of masses in a group from which sweeps alone sag, and small groups are solved directly
DIRECT_MOST = 16  # contacts of a group that is solved directly; with 20 it does worse than sweeps
UNKNOWNS = 3 * DIRECT_MOST  # of the direct solution
MOST = 32  # contacts of a pair of bodies: a bowl in a bowl needs 24
PATCH = 4  # contacts of a pair of bodies along one normal: three carry a load, one more stops rocking
SURE = 4  # normals of a pair of bodies that may stand for those of other pieces
LISTS = 256  # lists of pieces at a time; a pair whose list another one has taken makes its own again
SQUEEZED = 5e-5  # m, depth from which a contact counts as squeezed: more than a load leaves in a step
OPPOSITE = 0.5  # minus cosine of normals between which a body is squeezed: a wedge of 60 degrees
