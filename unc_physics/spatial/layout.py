"""Slices of the state and the error state; all indices are defined here."""

#: Size of one body's state ``[p(3), v(3), q(4, xyzw), omega(3)]``; all but ``q`` in the world frame.
STATE = 13
POSITION = slice(0, 3)
VELOCITY = slice(3, 6)
QUATERNION = slice(6, 10)
ANGULAR_VELOCITY = slice(10, 13)

#: First index of each block of the state, for kernels.
P, V, Q, W = 0, 3, 6, 10

#: Size of one body's error state ``[dp, dv, dtheta, domega]``; ``dtheta`` is in the body frame.
ERROR = 12
ERR_POSITION = slice(0, 3)
ERR_VELOCITY = slice(3, 6)
ERR_ROTATION = slice(6, 9)
ERR_ANGULAR_VELOCITY = slice(9, 12)

#: First index of each block of the error state, for kernels.
EP, EV, ER, EW = 0, 3, 6, 9
