"""Predictions of scenes, their probabilities and status, and the ranking of actions.

- Run a prediction: `predict` checks and assembles, `driver` calls the propagator.
  `request_checks` and `compute_budget` hold its limits.
- Result: `prediction` with a `snapshot` for each time, `predicted_body`, `tables`.
- Probabilities: `events` and `event_entries` (of commands), `regions`, `probability`.
- Status: `status` holds the functions for users. They call `diagnosis`, which decides on rollouts. For each
  snapshot it collects `evidence` (data), applies the rules of `diagnostics` (measure, limit, message), and
  makes a `body_status` for each body (result). `conservation_checks`, `rare_outcomes` and `step_motion`
  compute measures.
- Ranking: `rank`, `sequential_halving`, `actions` (changes of a scene and a belief).
"""
