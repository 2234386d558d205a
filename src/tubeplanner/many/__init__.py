"""Many plans at once: problems ready to travel, the processes that work on them, and what comes."""
