"""Columns of the arrays that hold pieces for kernels.

A body's frame is a row of 12 floats: the position of its centre of mass and its rotation matrix, row by row.
Pieces are rows of `PIECE` floats; their points and faces are rows of `ROW` floats of a second array. Few
arrays with named columns are used, because each array argument of a compiled function costs time at every
call.
"""

#: Kinds of pieces.
HULL, LATHE, HALF_SPACE = 0, 1, 2

#: Frame of a body: position, rotation matrix.
POSITION, ROTATION = 0, 3
FRAME = 12

#: Piece. Its kind and the row of its body's frame.
KIND, OWNER = 0, 1
ROUNDING = 2  # radius of the ball that sweeps the core [m]
CENTER, RADIUS, HALF_EXTENT = 3, 6, 7  # bounding sphere; half edges of the bounding box; body axes [m]
FIRST_POINT, LAST_POINT, FIRST_FACE, LAST_FACE = 10, 11, 12, 13  # ranges of rows; the last is exclusive
FIRST_ARC, LAST_ARC = 14, 15  # lathe: range of the rows of its arcs
ORIGIN, AXES = 16, 19  # lathe: a point on its axis, and its axes as columns of a rotation matrix, body axes
AZIMUTH, COS_HALF, SIN_HALF = 28, 30, 31  # lathe: direction of a sector's middle (x, y); its half-angle
PIECE = 32

#: Row of a point: coordinates in body axes; of a lathe radius, zero and height in its own axes.
#: Row of a face: outward normal, then the range of rows of its corners; of a lathe an edge of the profile.
#: Two rows of an arc: radius and height of its ends, and radial and axial part of the normals there.
CORNERS_FROM, CORNERS_TO = 3, 4
ROW = 5

#: Contact of a manifold: point in the middle of the gap, gap [m], normal from a to b, pieces, whose face it
#: is.
POINT, GAP, NORMAL, PIECE_A, PIECE_B, FACE_OF = 0, 3, 4, 7, 8, 9
FARNESS = 10  # scratch of `manifold.reduce`
CONTACT = 11
#: Values of `FACE_OF`: neither body's, a's or b's.
NO_FACE, FACE_OF_A, FACE_OF_B = 0, 1, 2

#: Most corners of a face that takes part in clipping, and rows of a polygon's array.
MOST_CORNERS, POLYGON = 64, 136
