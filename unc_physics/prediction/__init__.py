"""Predictions of scenes, their probabilities and status, and the ranking of actions.

- Run a prediction: `predict` checks and assembles, `driver` calls the propagator, `islands` divides the
  scene. `request_checks`, `marks`, `memory` and `compute_budget` hold its limits.
- Result: `prediction` with a `snapshot` for each time, `predicted_body`, `tables`.
- Probabilities: `events` and `event_entries` (events in files), `regions`, `probability`, `first_contacts`.
- Status: `status` (functions for users) calls `diagnosis` (which snapshots are judged, and with how many
  rollouts). For each snapshot that collects `evidence` (data), applies the rules of `diagnostics` (measure,
  limit, message), and returns a `body_status` for each body (result). `conservation_checks` and
  `rare_outcomes` compute single measures.
- Actions: `actions`, `actions_file`, `candidates`, `rank`, `sequential_halving`, `ranking_table`.
"""
