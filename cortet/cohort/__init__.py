"""Many surfaces: the cohort sheet, a run's plan, status and lock, the cost of jobs, the folder's description."""
