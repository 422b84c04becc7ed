"""What the document on stability says around its tables."""

COMMAND = "python -m unc_physics evaluate stability"
INTRODUCTION = f"""\
`{COMMAND}` predicts each scene of `evaluation/unc_physics_evaluation/hard_cases/` with every propagator that
can, and writes this document, `stability.md`, into its output folder. Every case is a scene file of its own
and can be tried by hand: `python -m unc_physics predict
evaluation/unc_physics_evaluation/hard_cases/grazing.yaml`. So it does with the paper's scenes, and with the
everyday motions of `everyday_cases.py`, each with a tight (1 mm, 10 mrad, 10 mm/s), a wide and a very wide
belief.

* **Implicit** cases are about what the implicit step is for: blows, friction, rest, stacks. Those in which
  nothing should take energy away say `restitution: 1` and have no friction; most leave the stiffness to the
  package. All propagators predict them.
* **Explicit** cases are about the paper's step: what it makes of a stiffness and a time step, and what all
  propagators make of extreme covariances.
* The **truth** is Monte Carlo with up to 1000 samples (fewer where rollouts take long) and steps a quarter as
  long, or shorter where an explicit step needs that. Beside it stand what two halves of it differ by (floor),
  and what twice as long steps change (step).
* A prediction of a body is **bad** if its spread in position or in rotation (square root of the trace of the
  covariance) is off by more than a factor of 2; two spreads of next to nothing are the same. Where bodies go
  through each other, or Monte Carlo's rollouts gain more than 2 % energy, all are bad: the step is wrong. A
  **flag** is `NOT_CONVERGED` or `OUTSIDE_VALIDITY` (`INITIAL_OVERLAP` is a fact about the question); it is
  false where the prediction is good, and missing where it is bad.
"""
SHOWN = """
## What it shows

* The implicit step meets every goal in every case. Where nothing should take energy away, the mean loses less
  than 0.1 % in its run: a ball that bounces for 60 s as little as one that is struck 68 times within 10 ms
  between two others. None gains as much as 0.1 %.
* What lies, lies. Bricks of a few centimetres with a mass ratio of 100 creep by a micrometre in a second: the
  light ones feel what is left of the solver's residual.
* The explicit step gains energy where the stiffness or the time step ask too much of it, and all predictions
  say so. So do they where the stiffness cannot stop the ball (`fast_ball_too_soft`).
* Rollouts gain no energy, wherever their step is right: on the implicit step those of Monte Carlo, `cloud`
  and `auto` 0.1 % at most. The samples that `cloud` and `auto` make of them are no states of any motion, and
  have another energy on average, by a few percent or, in the middle of a bounce, more. Linearization's
  covariance gains on the way: where a gap is uncertain, it has the contact close it within a step, and where
  a body tumbles, its product of derivatives grows.
* Monte Carlo is right wherever its step is; no status knows of a step that is too long for a can that rolls
  from sphere to sphere (`rolling_can`: with a quarter of the step, its spread is 1.6 times as wide). Sigma
  points are right with few bodies, and far too sure of themselves in piles with one joint covariance, which
  the status says. What rests on one nominal rollout is wrong more often than not after a contact: the status
  compares it with rollouts, twelve or, where these leave it open, 64.
* Sigma points are compared with rollouts where they are uneven or many, or turn so far that a rotation wraps
  around on both sides alike (`rest_ball_rolling`).
* Of all flags on good predictions, most are on spreads that are off by nearly a factor of 2. Fifteen are
  local sampling's in one scene, `sixty_four_pairs`, where all bodies are off by 1.7 to 2.7.
* Missed are a landing face by surrogate and local sampling (off by 2.01), a can's step (`rolling_can`), and
  single bodies of piles: 32 rollouts of a cloud tell nothing of what one in a hundred does, and their fourth
  moments no more.
"""
CELLS = """\
Each cell: energy gained by the rollouts on average, or by the expected motion where there is a single one or
points, spread included; spread of position / of rotation at the end over the truth's, of the body where it is
farthest off; and the bodies' flags: `fine` (right and not flagged), `flagged` (wrong and flagged), `false`
(right but flagged), `MISSING` (wrong and not flagged). Floor: the same ratio between two halves of the truth.
Step: between a truth with twice as long steps and this one, from the same samples."""
