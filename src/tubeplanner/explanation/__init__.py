"""Why a problem cannot be solved and what would help, or how much room one has that can."""
