"""Many estimations: their processes or cluster, their folder on disk, their table, their gauge."""
