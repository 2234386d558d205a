"""Many plans: in parallel, varied, compared, placed, explained."""
