"""Linear system of a group's contacts: six rows for each loaded body, for its impulse and moment."""

from ..compiler import inner
from ..spatial.rotation import cross


@inner(forceinline=True)
def add_answer(A, place, slot_i, slot_j, k, sign, arm, answer, turn_i, turn_j):
    """Add one column of B to the rows of a body at ``place``, for the velocities of both bodies."""
    moment = cross(arm, answer)
    for r in range(3):
        a, b = sign * answer[r], sign * moment[r]
        A[place + r, slot_i + k] += a
        A[place + 3 + r, slot_i + k] += b
        for m in range(3):
            A[place + r, slot_i + 3 + m] += a * turn_i[m]
            A[place + 3 + r, slot_i + 3 + m] += b * turn_i[m]
        if slot_j >= 0:
            A[place + r, slot_j + k] -= a
            A[place + 3 + r, slot_j + k] -= b
            for m in range(3):
                A[place + r, slot_j + 3 + m] -= a * turn_j[m]
                A[place + 3 + r, slot_j + 3 + m] -= b * turn_j[m]


@inner(forceinline=True)
def add_force(A, place, column, sign, force, moment):
    """Add an impulse and its moment to a right-hand side of the body at ``place``."""
    for r in range(3):
        A[place + r, column] += sign * force[r]
        A[place + 3 + r, column] += sign * moment[r]


@inner(error_model="numpy")
def eliminate(A, size, width):
    """Solve a linear system (size, size) in place; the columns up to ``width`` are right-hand sides."""
    for k in range(size):
        pivot = k
        for r in range(k + 1, size):
            if abs(A[r, k]) > abs(A[pivot, k]):
                pivot = r
        if pivot != k:
            for c in range(k, width):
                A[k, c], A[pivot, c] = A[pivot, c], A[k, c]
        for r in range(k + 1, size):
            factor = A[r, k] / A[k, k]
            if factor != 0.0:
                for c in range(k + 1, width):
                    A[r, c] -= factor * A[k, c]
    for c in range(size, width):
        for r in range(size - 1, -1, -1):
            total = A[r, c]
            for k in range(r + 1, size):
                total -= A[r, k] * A[k, c]
            A[r, c] = total / A[r, r]
